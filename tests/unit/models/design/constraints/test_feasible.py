"""No current that leaves here is outside any limit, however the limits are chosen."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.design.constraints.feasible import Demands, Feasible
from models.design.constraints.limits import CurrentBounds, InfeasibleError, Limits
from models.design.constraints.voltage_band import VoltageBand
from models.design.information.experiment import Evaluator
from tests.unit.models.design.networks import experiment

CAPACITY_AH, DT_S = 2.0, 10.0
TIGHT = 1e-7


def assert_kept(limits: Limits, start: float, current: np.ndarray) -> None:
    """Counted anew, from the definition of each limit."""
    assert limits.current_A[0] - TIGHT <= current.min() and current.max() <= limits.current_A[1] + TIGHT
    soc = start + np.cumsum(current) * DT_S / 3600.0 / CAPACITY_AH
    assert limits.soc[0] - TIGHT <= soc.min() and soc.max() <= limits.soc[1] + TIGHT
    if limits.ramp_A_per_s is not None:
        steps = np.diff(np.concatenate([[0.0], current, [0.0]])) / DT_S
        assert limits.ramp_A_per_s[0] - TIGHT <= steps.min() and steps.max() <= limits.ramp_A_per_s[1] + TIGHT
    if limits.net_charge_Ah is not None:
        charge = current.sum() * DT_S / 3600.0
        assert limits.net_charge_Ah[0] - TIGHT <= charge <= limits.net_charge_Ah[1] + TIGHT


@settings(max_examples=150, deadline=None)
@given(
    data=st.data(),
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 120),
    discharge=st.floats(0.1, 20.0),
    charge=st.floats(0.1, 20.0),
    low=st.floats(0.0, 0.8),
    width=st.floats(0.01, 0.2),
)
def test_random_limits_are_kept(
    data: st.DataObject, seed: int, n: int, discharge: float, charge: float, low: float, width: float
) -> None:
    window = (low, min(low + width, 1.0))
    start = window[0] + data.draw(st.floats(0.0, 1.0)) * (window[1] - window[0])
    ramp = data.draw(st.none() | st.tuples(st.floats(-5.0, -1e-3), st.floats(1e-3, 5.0)))
    net = data.draw(st.none() | st.floats(-0.02, 0.02).map(lambda x: (min(x, 0.0), max(x, 0.0))))
    limits = Limits((-discharge, charge), window, ramp_A_per_s=ramp, net_charge_Ah=net)
    feasible = Feasible(experiment(initial_soc=start), Demands(limits), n)
    wanted = np.random.default_rng(seed).uniform(-30.0, 30.0, n)
    assert_kept(limits, start, feasible.finish(wanted))
    assert_kept(limits, start, feasible.finish(np.full(n, 30.0)))


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), below=st.floats(0.03, 0.3), above=st.floats(0.03, 0.3), error=st.floats(0.0, 5e-3)
)
def test_the_predicted_voltage_stays_inside_with_its_band(seed: int, below: float, above: float, error: float) -> None:
    rest_V = 3.3 + 0.5 * 0.5
    limits = Limits((-15.0, 15.0), (0.3, 0.7), voltage_V=(rest_V - below, rest_V + above))
    where = experiment()
    feasible = Feasible(where, Demands(limits, band=VoltageBand(error, 1e8 * np.eye(15))), 100)
    current = feasible.finish(np.random.default_rng(seed).uniform(-15.0, 15.0, 100))
    predicted = Evaluator(where, 100).predict(current)
    width = VoltageBand(error, 1e8 * np.eye(15)).width_V(where, current, predicted)
    assert (predicted.voltage_V + width).max() <= rest_V + above
    assert (predicted.voltage_V - width).min() >= rest_V - below


def test_the_voltages_room_is_used() -> None:
    limits = Limits((-15.0, 15.0), (0.3, 0.7), voltage_V=(3.4, 3.7))
    feasible = Feasible(experiment(), Demands(limits, band=VoltageBand(5e-3, 1e8 * np.eye(15))), 100)
    low, high = feasible.voltage_band_V(feasible.finish(np.repeat([-15.0, 15.0, -15.0, 15.0], 25)))
    assert 3.4 <= low.min() < 3.405 and 3.695 < high.max() <= 3.7


def test_what_is_allowed_already_stays_as_it_is() -> None:
    limits = Limits((-5.0, 5.0), (0.2, 0.8), ramp_A_per_s=(-1.0, 1.0))
    wanted = np.concatenate([np.linspace(0.5, 3.0, 20), np.linspace(3.0, 0.5, 20)])
    np.testing.assert_array_equal(Feasible(experiment(), Demands(limits), 40).finish(wanted), wanted)


def test_bounds_that_exclude_rest_and_a_ramp_are_kept_together() -> None:
    low = np.repeat([-5.0, 2.0, -5.0, 2.0], 15)
    high = np.repeat([-2.0, 5.0, -2.0, 5.0], 15)
    limits = Limits((-5.0, 5.0), (0.2, 0.8), ramp_A_per_s=(-0.2, 0.2))
    current = Feasible(experiment(), Demands(limits, CurrentBounds(low, high)), 60).finish(np.zeros(60))
    assert_kept(limits, 0.5, current)
    # Away from the changes, which the ramp needs, the bounds hold.
    assert current[7] <= -2.0 + TIGHT and current[22] >= 2.0 - TIGHT


def test_the_limitation_ratio_scales_the_bounds_by_the_state_of_charge() -> None:
    bounds = CurrentBounds(
        np.full(300, -5.0), np.full(300, 5.0), np.array([0.2, 0.4, 0.8]), np.array([0.0, 1.0, 1.0]), np.ones(3)
    )
    limits = Limits((-5.0, 5.0), (0.1, 0.9))
    current = Feasible(experiment(), Demands(limits, bounds), 300).finish(np.full(300, -9.0))
    soc = 0.5 + np.concatenate([[0.0], np.cumsum(current)[:-1]]) * DT_S / 7200.0
    allowed = -5.0 * np.interp(soc, bounds.soc, bounds.discharge_ratio)
    assert (current >= allowed - 1e-9).all() and soc.min() > 0.2
    # Towards the low end nothing but the ratio holds the current back.
    assert (current < 0.9 * allowed)[-20:].all() and (current > -4.9).any()


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"current_A": (1.0, 2.0)}, "current_A.*hold 0"),
        ({"current_A": (2.0, -2.0)}, "current_A.*low end"),
        ({"soc": (0.8, 0.2)}, "soc.*low end"),
        ({"soc": (-0.1, 0.5)}, "within 0..1"),
        ({"soc": (0.6, 0.9)}, "soc.*stands at 0.5"),
        ({"voltage_V": (3.0, 3.1)}, "voltage_V.*expects 3.549"),
        ({"net_charge_Ah": (0.9, 1.0)}, "soc.*net_charge_Ah.*conflict"),
        ({"net_charge_Ah": (0.5, 0.6), "ramp_A_per_s": (-1e-3, 1e-3)}, "ramp_A_per_s"),
        ({"temperature_degC": (0.0, 40.0)}, "nothing predicts"),
    ],
)
def test_conflicts_are_named(changes: dict, says: str) -> None:
    fields = {"current_A": (-5.0, 5.0), "soc": (0.1, 0.9)} | changes
    with pytest.raises(InfeasibleError, match=says):
        Feasible(experiment(), Demands(Limits(**fields), band=VoltageBand(1e-3)), 100)


def test_a_predicted_temperature_too_high_makes_the_current_smaller() -> None:
    limits = Limits((-5.0, 5.0), (0.1, 0.9), temperature_degC=(0.0, 30.0))
    warms = Demands(limits, temperature_of=lambda current: 25.0 + np.cumsum(current**2) * 0.01)
    current = Feasible(experiment(), warms, 100).finish(np.tile([5.0, -5.0], 50))
    assert 29.9 < 25.0 + (current**2).sum() * 0.01 <= 30.0


def test_samples_at_a_limit_are_found() -> None:
    feasible = Feasible(experiment(), Demands(Limits((-5.0, 5.0), (0.1, 0.9))), 4)
    np.testing.assert_array_equal(feasible.touched(np.array([5.0, 0.0, -5.0, 1.0])), [True, False, True, False])
