"""What runs say of the cell whatever flowed before them."""

from dataclasses import replace

import numpy as np

from models.data.resampling import GridRun
from models.identification.bounded.fitted import BoundedFit, fit_variant
from models.identification.bounded.open_starts import transients, with_open_starts
from models.identification.bounded.variants import Trials, Variant
from models.network.regression import SignalBank
from tests.unit.models.identification.bounded.bank import bank


def with_false_starts(signals: SignalBank, volts: float) -> SignalBank:
    """The same runs, each of which begins in a relaxation that nobody knows of."""

    def bent(run: GridRun) -> GridRun:
        return replace(run, voltage_V=run.voltage_V + volts * np.exp(-run.dt_s * np.arange(len(run)) / 400.0))

    return SignalBank([bent(run) for run in signals.runs], signals.initial_soc, signals.cell)


def fit(signals: SignalBank) -> BoundedFit:
    return fit_variant(Trials(signals), Variant())


def curve_V(found: BoundedFit) -> np.ndarray:
    return found.coefficients[: found.layout.n_curve]


def test_a_relaxation_at_the_start_bends_a_fit_but_not_what_is_said_whatever_flowed_before() -> None:
    signals = bank(swing_K=0.0)
    true, false = fit(signals), fit(with_false_starts(signals, 0.03))
    freed = with_open_starts(false)
    bent, left = (np.sqrt(np.mean((curve_V(each) - curve_V(true)) ** 2)) for each in (false, freed))
    assert bent > 2e-3
    assert left < 0.4 * bent


def test_runs_that_begin_at_rest_say_the_same_of_the_cell_with_open_starts() -> None:
    found = fit(bank(swing_K=0.0))
    assert np.sqrt(np.mean((curve_V(with_open_starts(found)) - curve_V(found)) ** 2)) < 1.5e-3


def test_transients_die_out_with_time_and_with_the_charge_that_flows() -> None:
    run = bank().runs[0]
    made = transients(run, 2.5)
    assert (made[0, :-2] == 1.0).all()
    assert (np.diff(made, axis=0) <= 0.0).all()
    resting = transients(replace(run, current_A=np.zeros(len(run))), 2.5)
    assert (resting[:, -2:] == 1.0).all()
