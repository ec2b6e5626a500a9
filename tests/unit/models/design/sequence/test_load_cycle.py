import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.data.errors import ModelError
from models.design.constraints.feasible import Demands, Feasible
from models.design.constraints.limitation import LimitationRatio, default_ratio
from models.design.constraints.limits import Limits
from models.design.sequence.load_cycle import load_cycle_bounds, load_histogram
from tests.unit.models.design.networks import experiment

CYCLE_A = np.concatenate([np.zeros(300), np.repeat([-4.0, 3.0, -2.0, 1.5, -5.0, 4.0], 50)])
FLAT = LimitationRatio(np.array([0.0, 1.0]), np.ones(2), np.ones(2))


def test_histogram_by_hand() -> None:
    found = load_histogram(np.array([-2.0, -2.0, 0.0, 2.0]), 2)
    np.testing.assert_allclose(found.edges_A, [-2.0, 0.0, 2.0])
    np.testing.assert_allclose(found.share, [0.5, 0.5])
    weighted = load_histogram(np.array([-2.0, 2.0]), 2, np.array([3.0, 1.0]))
    np.testing.assert_allclose(weighted.share, [0.75, 0.25])
    assert weighted.mean_A() == pytest.approx(-0.5)


def test_every_interval_holds_for_its_share_of_the_time() -> None:
    histogram = load_histogram(CYCLE_A, 9)
    bounds = load_cycle_bounds(histogram, 3000, 1.0, (-5.0, 5.0), FLAT, np.random.default_rng(0))
    for low, high, share in zip(histogram.edges_A[:-1], histogram.edges_A[1:], histogram.share, strict=True):
        here = np.isclose(bounds.low_A, low) & np.isclose(bounds.high_A, high)
        assert here.mean() == pytest.approx(share, abs=1.0 / 3000)


def test_the_order_keeps_the_charge_where_it_is() -> None:
    bounds = load_cycle_bounds(load_histogram(CYCLE_A, 9), 6000, 1.0, (-5.0, 5.0), FLAT, np.random.default_rng(0))
    middle = 0.5 * (bounds.low_A + bounds.high_A)
    away = np.cumsum(middle - middle.mean())
    assert np.ptp(away) < 2.0 * 60.0 * 5.0


def test_a_cycle_beyond_the_cell_is_scaled_as_a_whole() -> None:
    bounds = load_cycle_bounds(load_histogram(CYCLE_A, 9), 900, 1.0, (-2.5, 10.0), FLAT, np.random.default_rng(0))
    assert bounds.low_A.min() == pytest.approx(-2.5) and bounds.high_A.max() == pytest.approx(2.0)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), start=st.floats(0.25, 0.75), n=st.integers(20, 300))
def test_currents_stay_within_the_cycles_intervals_and_the_window(seed: int, start: float, n: int) -> None:
    rng = np.random.default_rng(seed)
    ratio = default_ratio((0.05, 0.95))
    bounds = load_cycle_bounds(load_histogram(CYCLE_A, 9), n, 10.0, (-5.0, 5.0), ratio, rng)
    demands = Demands(Limits((-5.0, 5.0), (0.05, 0.95)), bounds)
    current = Feasible(experiment(initial_soc=start), demands, n).finish(rng.uniform(-9.0, 9.0, n))
    soc = start + np.concatenate([[0.0], np.cumsum(current)]) * 10.0 / 7200.0
    low, high = bounds.at(soc[:-1])
    assert (current >= low - 1e-7).all() and (current <= high + 1e-7).all()
    assert soc.min() >= 0.05 - 1e-7 and soc.max() <= 0.95 + 1e-7


def test_bad_cycles_and_ratios_are_refused() -> None:
    with pytest.raises(ModelError, match="two different"):
        load_histogram(np.zeros(10))
    with pytest.raises(ModelError, match="must rise"):
        LimitationRatio(np.array([0.5, 0.5]), np.ones(2), np.ones(2))
    with pytest.raises(ModelError, match="discharge"):
        LimitationRatio(np.array([0.0, 1.0]), np.array([0.0, 2.0]), np.ones(2))
