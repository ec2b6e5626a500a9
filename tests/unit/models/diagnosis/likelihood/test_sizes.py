"""What is nothing already cannot become less, few training runs leave more open than many, no equation is exact."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import truncnorm

from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.diagnosis import diagnose
from models.diagnosis.known.elsewhere import UNLEARNED
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.likelihood.background import Background, Weighed
from models.diagnosis.likelihood.learning import know
from models.diagnosis.likelihood.sizes import averaged, doubt, possible, widened
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.effects import effect, effects
from models.identification.bounded.variants import Variant
from models.network.signals import RunSignals
from simulators.catalogue import CELLS
from tests.unit.models.diagnosis.cells import SOC, measured, simple_network
from tests.unit.models.effects.linear_cell import linear_view

CELL = CELLS["nmc"].parameters
LOOP_V = 0.03


@pytest.mark.parametrize(
    ("least", "mean", "gain"),
    [
        (-np.inf, -5.0, 0.0),  # may be anything: nothing is gained or lost
        (0.0, 5.0, np.log(2.0)),  # half of what was possible is what was seen
        (0.0, -5.0, -14.4),  # log of 2 Phi(-5)
        (-5.0, -5.0, np.log(0.5)),  # at the edge of what can be, which nearly all sizes are within
    ],
)
def test_a_size_that_cannot_be_costs_what_its_probability_says(least: float, mean: float, gain: float) -> None:
    weighed = Weighed(3.0, np.array([mean]), np.eye(1))
    assert possible(weighed, least)[1] == pytest.approx(gain, abs=0.06)


@pytest.mark.parametrize("mean", [-6.0, -1.0, 0.0, 2.0])
def test_sizes_are_those_of_the_distribution_that_is_left(mean: float) -> None:
    covariance = np.array([[1.0, 0.6], [0.6, 2.0]])
    found, _ = possible(Weighed(0.0, np.array([mean, 1.0]), covariance), -0.5)
    left = truncnorm(-0.5 - mean, np.inf, loc=mean)
    assert found.mean[0] == pytest.approx(left.mean(), rel=1e-6)
    assert found.covariance[0, 0] == pytest.approx(left.var(), rel=1e-4)
    assert found.mean[1] == pytest.approx(1.0 + 0.6 * (left.mean() - mean))
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0


@pytest.mark.parametrize("mean", [-1e3, -1e9])
def test_what_lies_absurdly_far_beyond_the_edge_is_still_a_distribution(mean: float) -> None:
    covariance = np.array([[1.0, 0.6], [0.6, 2.0]])
    found, more = possible(Weighed(0.0, np.array([mean, 1.0]), covariance), 0.0)
    assert 0.0 <= found.mean[0] < 1.0
    assert np.isfinite(found.mean).all() and more < -1e5
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0


def test_a_loop_can_close_and_no_more_and_charge_makes_no_film_thinner() -> None:
    forms = effect("hysteresis").expected.forms
    growth = effect("resistance_growth").expected.forms
    assert forms is not None
    assert growth is not None
    assert {each.least for each in forms(linear_view())} == {0.0}
    assert {each.least for each in growth(linear_view())} == {0.0}


@pytest.fixture(scope="module")
def memory() -> KnownRuns:
    return know([to_grid(measured(CELL, 1), 1.0)], [SOC], CELL.capacity_Ah, list(effects().values()), Variant())


def inside_out(run: TimeSeries) -> TimeSeries:
    """The same log with a loop that is lower after charge than after discharge."""
    grid = to_grid(run, 1.0)
    signals = RunSignals(grid.current_A, grid.temperature_degC, np.zeros(len(grid)), 1.0, CELL.capacity_Ah)
    loop_V = np.interp(run.time_s, grid.time_s, signals.values("hysteresis_state:20"))
    return replace(run, voltage_V=run.voltage_V - LOOP_V * loop_V)


def test_a_loop_that_is_inside_out_is_told_as_one_that_has_closed_at_the_most(memory: KnownRuns) -> None:
    odd = inside_out(measured(CELL, 2))
    answer = diagnose(simple_network(CELL.capacity_Ah), [odd], [SOC], mode="change", memory=memory)
    had_V = float(np.mean(memory.cell.loop_V(np.linspace(0.2, 0.9, 8))))
    loops = [each.parameters["amplitude_V"].value for each in answer.findings if each.effect == "hysteresis"]
    assert all(each >= -had_V - 1e-6 for each in loops)


@pytest.mark.parametrize(("runs", "factor"), [(1, 6.48), (2, 6.48), (3, 2.195), (20, 1.068)])
def test_few_runs_say_little_of_how_much_runs_differ(runs: int, factor: float) -> None:
    """Student's two-sided 95 % over the normal distribution's, of tables."""
    known = replace(UNLEARNED.known, run=np.repeat(np.arange(runs), 5).astype(float))
    learned = replace(UNLEARNED, granted={"hysteresis": 0.1}, known=known)
    assert doubt(learned) == pytest.approx(factor, rel=1e-3)
    assert doubt(replace(learned, granted={})) == 1.0


@pytest.mark.parametrize(("elsewhere", "wider"), [(0.0, 1.0), (1.0, 2.0)])
def test_only_what_was_learned_is_doubted(elsewhere: float, wider: float) -> None:
    """Noise is known; what differs from run to run by far more makes a size as uncertain as that is."""
    rng = np.random.default_rng(3)
    columns = rng.standard_normal((300, 1))
    back = Background(
        0.1 * columns[:, 0] + rng.standard_normal(300), (1.01 - elsewhere) * np.eye(300), elsewhere * np.eye(300)
    )
    found = back.weigh(columns)
    now = widened(back, found, columns, None, 2.0)
    assert now.mean == found.mean
    assert np.sqrt(now.covariance[0, 0] / found.covariance[0, 0]) == pytest.approx(wider, rel=0.1)


def test_a_large_change_is_as_sure_as_its_equation_at_the_most() -> None:
    columns = np.ones((300, 1))
    back = Background(2.0 * columns[:, 0], 1e-6 * np.eye(300), 0.0 * np.eye(300))
    found = widened(back, back.weigh(columns), columns, None, 1.0)
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(2.0 * THRESHOLDS.equation, rel=1e-3)


def test_sizes_are_open_by_as_much_as_other_explanations_would_have_them_lie_elsewhere() -> None:
    told, other = (Weighed(0.0, np.array([mean]), np.array([[v]])) for mean, v in ((1.0, 0.01), (2.0, 0.04)))
    found = averaged(told, 0.6, [(0.2, other)])
    assert found.mean[0] == 1.0
    assert found.covariance[0, 0] == pytest.approx((0.6 * 0.01 + 0.2 * (0.04 + 1.0)) / 0.8)
    assert averaged(told, 0.6, []) is told
