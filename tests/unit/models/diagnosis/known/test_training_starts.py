"""Where training runs begin is found with the cell: neither a wrong count nor a relaxation passes for its error."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import GridRun
from models.diagnosis.known.fitting import fit_known
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.known.training_starts import Fitted, training_starts
from models.diagnosis.likelihood.learning import know
from models.effects import effects
from models.identification.bounded.knots import hats
from models.identification.bounded.variants import Variant
from tests.unit.models.diagnosis.known.hand_cell import SOC, known_runs, trained
from tests.unit.models.hand_network import CAPACITY_AH

NOISE_V = 5e-4


def rms_V(known: KnownRuns) -> float:
    return float(np.sqrt(np.mean(known.elsewhere.unseen_V**2)))


def known_from(runs: list[GridRun], soc: list[float]) -> KnownRuns:
    return know(runs, soc, CAPACITY_AH, list(effects().values()), Variant())


def relaxing(run: GridRun, volts: float) -> GridRun:
    """Began in the middle of a relaxation that nobody logged."""
    return replace(run, voltage_V=run.voltage_V + volts * np.exp(-run.time_s / 600.0))


@pytest.mark.parametrize("off", [0.004, -0.007])
def test_states_of_charge_that_contradict_each_other_bend_nothing(off: float) -> None:
    """0.7 V over the whole charge: contradictions of 6 and 10 mV, that of a careful statement."""
    found = known_from([trained(1), trained(2), trained(3)], [SOC + off, SOC - off, SOC])
    assert rms_V(found) < 1.5 * NOISE_V
    soc = np.linspace(*found.cell.soc_range, 9)
    moved_V = found.cell.open_circuit_V(soc) - known_runs().cell.open_circuit_V(soc)
    assert np.ptp(moved_V) < 1e-3


@pytest.mark.parametrize("end", [0.0, 0.004, 0.997, 1.0])
def test_a_run_that_begins_full_or_empty_begins_there(end: float) -> None:
    """As far as anybody says it: to half a point."""
    rough = known_runs().cell
    runs, size = [relaxing(trained(1), 0.006), relaxing(trained(2), 0.006)], rough.layout.size
    whole = Fitted(rough, np.ones(size, dtype=bool), np.eye(size), [np.arange(4000)] * 2, [np.zeros(4000)] * 2, 1e-9)
    found = training_starts(whole, runs, [end, 0.5])
    assert not found.volts[0].any() and found.volts[1].any()


def test_a_log_that_begins_in_a_relaxation_bends_nothing() -> None:
    found = known_from([relaxing(trained(1), 0.006), trained(2)], [SOC, SOC])
    assert rms_V(found) < 1.5 * NOISE_V


def test_what_was_simulated_begins_where_it_is_said_to() -> None:
    runs, soc = [relaxing(trained(1), 0.006), trained(2)], [SOC + 0.004, SOC]
    taken = fit_known(runs, soc, CAPACITY_AH, Variant(), starts_known=True)[1]
    assert np.sqrt(np.mean(taken.unseen_V**2)) > 2.0 * rms_V(known_from(runs, soc))


def test_what_the_starts_leave_open_is_open_of_the_cell() -> None:
    """Two runs, each right within half a point: their curve is by 0.7 V over the whole charge known to 2.5 mV."""
    runs = [trained(1), trained(2)]
    found, exact = (fit_known(runs, [SOC, SOC], CAPACITY_AH, Variant(), starts_known=each)[0] for each in (False, True))
    middle = np.zeros(found.layout.size)
    middle[: found.layout.n_curve] = hats(found.layout.knots.soc, np.array([SOC]))[0]
    open_V, exact_V = (float(np.sqrt(middle @ each.covariance @ middle)) for each in (found, exact))
    assert exact_V < 1e-3
    assert 1.5e-3 < open_V < 4e-3


def test_what_the_starts_leave_open_is_no_error_of_the_cell() -> None:
    """Runs that begin as they are said to are known as well as before."""
    assert rms_V(known_runs()) < 1.3 * NOISE_V
    variances = known_runs().elsewhere.variances
    assert np.isfinite(variances).all() and (variances >= 0.0).all()


def test_a_run_with_what_flowed_before_in_front_begins_there() -> None:
    """Its grid then begins at a negative time."""
    runs = [replace(run, time_s=run.time_s - 30_000.0) for run in (trained(1), trained(2))]
    found = known_from(runs, [SOC, SOC])
    assert rms_V(found) == pytest.approx(rms_V(known_runs()), rel=1e-9)
