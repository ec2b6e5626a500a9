from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.diagnosis.known.cell import SURFACE
from models.diagnosis.known.elsewhere import OWN_LOAD, PLACES, TIMES
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.trend.answer import growth_Ohm
from models.diagnosis.trend.choice import around_steps, chosen
from models.diagnosis.trend.ends import ends_of
from models.diagnosis.trend.estimate import seen, weighed
from models.diagnosis.trend.quick import quick_rows, steps_of
from models.diagnosis.trend.settings import SETTINGS
from tests.unit.models.diagnosis.hand_reference import EMPTY_V, SLOPE_V
from tests.unit.models.diagnosis.known.hand_cell import known_runs, true_run
from tests.unit.models.hand_network import CAPACITY_AH

FRESH_OHM = 0.02


@pytest.fixture(scope="module")
def whole() -> KnownRuns:
    """As if the cell had been known from empty to full."""
    known = known_runs()
    cell, coefficients = known.cell, known.cell.coefficients.copy()
    coefficients[: cell.layout.n_curve] = EMPTY_V + SLOPE_V * cell.layout.knots.soc
    domain = cell.domain | {"soc": (0.0, 1.0), SURFACE: (0.0, 1.0)}
    return replace(known, cell=replace(cell, domain=domain, coefficients=coefficients))


def discharge(capacity_Ah: float, grown_Ohm: float = 0.0) -> GridRun:
    """From full to empty at 1C of the fresh cell, after a short rest."""
    current_A = np.full(int(3600 * capacity_Ah / CAPACITY_AH) + 20, -CAPACITY_AH)
    current_A[:20] = 0.0
    return true_run(current_A, soc=1.0, capacity_Ah=capacity_Ah, added_V=grown_Ohm * current_A, noise_V=2e-4, seed=3)


@pytest.mark.parametrize("lost", [0.0, 0.08, 0.2])
def test_the_charge_between_full_and_empty_is_the_capacity(whole: KnownRuns, lost: float) -> None:
    run = discharge(CAPACITY_AH * (1.0 - lost), grown_Ohm=0.01 * lost)
    found = ends_of(whole.cell, run, 1.0)
    assert len(found.index) == 1 and found.soc[0] == pytest.approx(0.0, abs=0.02)
    state = weighed(seen(whole, run, 1.0, 0.005)).state
    assert state.capacity_Ah == pytest.approx(CAPACITY_AH * (1.0 - lost), rel=0.02)
    assert 0.01 * state.capacity_Ah <= state.capacity_std_Ah < 0.03 * state.capacity_Ah


def test_a_run_that_ends_half_way_ends_nowhere(whole: KnownRuns) -> None:
    half = discharge(0.5 * CAPACITY_AH)
    run = true_run(half.current_A, soc=1.0, noise_V=2e-4)
    assert len(ends_of(whole.cell, run, 1.0).index) == 0


def test_an_end_in_a_pulse_says_less_than_one_of_a_steady_current(whole: KnownRuns) -> None:
    steady = discharge(CAPACITY_AH)
    current_A = steady.current_A.copy()
    current_A[20:-120] *= 0.5
    current_A = np.concatenate([current_A[:20], np.repeat(current_A[20:-120], 2), current_A[-120:]])
    pulsed = true_run(current_A, soc=1.0, noise_V=2e-4)
    found = [ends_of(whole.cell, run, 1.0) for run in (steady, pulsed)]
    assert [len(each.index) for each in found] == [1, 1]
    assert [each.std.tolist() for each in found] == [[SETTINGS.end_std], [SETTINGS.pulse_end_std]]
    assert SETTINGS.end_std < SETTINGS.pulse_end_std


def test_the_step_at_its_start_tells_the_resistance(whole: KnownRuns) -> None:
    state = weighed(seen(whole, discharge(0.9 * CAPACITY_AH, grown_Ohm=0.012), 1.0, 0.005)).state
    assert state.resistance_Ohm[-1] == pytest.approx(FRESH_OHM + 0.012, rel=0.15)


def test_the_step_tells_the_resistance_that_a_run_has_of_its_own_too(whole: KnownRuns) -> None:
    """A cell whose runs differ in their load at each state of charge: what the step shows is still its resistance."""
    variances = whole.elsewhere.variances.copy()
    variances[len(PLACES) + TIMES.index(OWN_LOAD)] = 1e4
    odd = replace(whole, elsewhere=replace(whole.elsewhere, variances=variances))
    state = weighed(seen(odd, discharge(0.9 * CAPACITY_AH, grown_Ohm=0.012), 1.0, 0.005)).state
    assert state.resistance_Ohm[-1] == pytest.approx(FRESH_OHM + 0.012, rel=0.05)


def test_ohms_that_are_the_same_everywhere_are_told_where_the_current_never_steps(whole: KnownRuns) -> None:
    found = weighed(seen(whole, discharge(CAPACITY_AH, grown_Ohm=0.012), 1.0, 0.005))
    grown, std = growth_Ohm(found, found.told(("resistance",)))
    assert grown == pytest.approx(0.012, rel=0.15)
    assert float(std.max()) < 0.15 * 0.012


def test_resistance_of_the_fresh_cell_is_read_off_its_coefficients(whole: KnownRuns) -> None:
    run = discharge(CAPACITY_AH)
    steps = steps_of(whole.cell, run, np.array([0.5]), 1.0 + run.charge_Ah / CAPACITY_AH)
    assert steps.current_A < 0.0
    assert (quick_rows(whole.cell, steps) @ whole.cell.coefficients)[0] == pytest.approx(FRESH_OHM, rel=0.02)


def test_a_handful_of_samples_tells_nothing(whole: KnownRuns) -> None:
    run = discharge(CAPACITY_AH)
    few = replace(run, measured=np.arange(len(run)) % 500 == 0)
    with pytest.raises(ModelError, match="at least 30"):
        weighed(seen(whole, few, 1.0, 0.005))


def test_samples_around_steps_and_both_ends_are_looked_at() -> None:
    current_A = np.zeros(100)
    current_A[40:] = -2.0
    assert {39, 40, 41} <= set(around_steps(current_A, 0.2).tolist())
    assert len(around_steps(current_A, 3.0)) == 0
    places = np.arange(7, 100)
    assert chosen(places, 10)[[0, -1]].tolist() == [7, 99]
    assert chosen(places[:5], 10).tolist() == places[:5].tolist()
