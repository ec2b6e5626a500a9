"""One run through the observer, how good its state of charge was, and the answer over all runs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.data.timeseries import FloatArray
from models.effects.input_correction import as_read
from models.observer.constancy import with_honest_bands
from models.observer.filter.fuzzy_observer import FuzzyObserver
from models.observer.filter.settings import GAINS, default_settings
from models.observer.health import alarms_of, watch
from models.observer.smoothing import Smoothed, smoothed_soc
from models.observer.tuning.accuracy import soc_figures

if TYPE_CHECKING:
    from models.data.timeseries import TimeSeries
    from models.network.local_model_network import LocalModelNetwork
    from models.observer.module.module_observer import ModuleObserver

# Distance from the trained temperatures that is worth a word: a cell that warms itself by less is as it was.
_TOLD_K = 2.0
# What is proven of each gain. The search for a proof takes seconds and is left to the report.
_NOT_CERTIFIED = {
    "kalman": "not certified: the gain comes from the covariance of the moment, and no proof says that its error dies "
    "out; what is proven of the steady gains (observe --report) does not hold for it",
    "steady": "not certified by this answer: whether the error dies out with steady gains, once the start is over, is "
    "looked into by observe --report",
}


@dataclass(frozen=True, slots=True)
class Observation:
    """Estimates of one run on the model's grid, all of shape (n,), and what they are worth.

    Attributes
    ----------
    soc_ref : NaN where unknown, None without any
    figures : `soc_rmse`, `soc_max_error`, `soc_end_error`, `converged_after_s`, `coverage_95`; None without reference
    seconds : time the replay took
    alarms : what was wrong on the way, in words
    sensors : `current_offset_A` and `capacity_Ah` at the end with their standard deviation; None where the run cannot
        tell them
    smoothed : state of charge with all of the run known
    smoothed_figures : the same figures of it; with all known there is no convergence to wait for
    """

    name: str
    time_s: FloatArray
    soc: FloatArray
    soc_std: FloatArray
    model_voltage_V: FloatArray
    innovation_V: FloatArray
    soc_ref: FloatArray | None
    figures: dict[str, float | None]
    seconds: float
    alarms: list[str]
    sensors: dict[str, dict[str, float] | None]
    smoothed: Smoothed
    smoothed_figures: dict[str, float | None]


def observer_of(network: LocalModelNetwork, gain: str | None = None) -> FuzzyObserver:
    """Build the observer of a model with a gain of somebody's choice.

    Parameters
    ----------
    network : the model of a cell
    gain : "kalman": from the covariance of the moment; "steady": the local models' steady-state gains from the discrete
        Riccati equation, blended by the validity functions (eq. 2.42 to 2.46 of the method, put right as
        `filter.gains` says), once the start is over; None: as the model's own settings have it

    Raises
    ------
    ModelError
        There is no such gain, or the network has no observer.
    """
    if gain is not None and gain not in GAINS:
        raise ModelError(f"gain {gain!r} is not known; use one of {', '.join(GAINS)}")
    settings = default_settings(network)
    return FuzzyObserver(network, settings if gain is None else replace(settings, gain=gain))


def observe(
    observer: FuzzyObserver | ModuleObserver, run: TimeSeries, soc: float, soc_std: float | None
) -> Observation:
    """Replay a run.

    Parameters
    ----------
    observer : of a cell, or of a module
    run : TimeSeries
    soc, soc_std : where the observer starts, fractions; `soc_std` None takes the observer's own
    """
    grid = to_grid(as_read(observer.network.record, run), observer.dt_s)
    temperature_degC = grid.temperature_degC
    known = temperature_degC[~np.isnan(temperature_degC)]
    state = observer.initial(soc, soc_std, float(known[0]) if len(known) else 25.0)
    arrays = (grid.logged_current_A, grid.voltage_V, temperature_degC)
    observer.replay(state, *(values[:1] for values in arrays))  # the first call may compile
    started = time.perf_counter()
    end, rows = observer.replay(state, *arrays)
    seconds = time.perf_counter() - started
    told, remarks = with_honest_bands(observer.told_sensors(rows[-1]), rows)
    figures = soc_figures(grid.time_s, rows[:, 0], rows[:, 1], grid.soc_ref)
    whole = isinstance(observer, FuzzyObserver)
    cell, as_cell = (observer, grid) if whole else (observer.cell, observer.mean_cell_grid(grid))
    smoothed = smoothed_soc(cell, as_cell, end, rows)
    return Observation(
        run.name,
        grid.time_s,
        rows[:, 0],
        rows[:, 1],
        rows[:, 2],
        rows[:, 3],
        grid.soc_ref,
        figures,
        seconds,
        [*alarms_of(watch(rows, grid.voltage_V)), *remarks, *_elsewhere(cell.network, known)],
        told,
        smoothed,
        soc_figures(grid.time_s, smoothed.soc, smoothed.soc_std, grid.soc_ref),
    )


def _elsewhere(network: LocalModelNetwork, temperature_degC: FloatArray) -> list[str]:
    """What to say of a run that is colder or warmer than all that a model was made from."""
    low, high = network.record.domain.get("temperature_degC", (-np.inf, np.inf))
    said = []
    for word, away_K, end in (("colder", low - temperature_degC, np.min), ("warmer", temperature_degC - high, np.max)):
        if (away_K > _TOLD_K).any():
            share, here = float((away_K > 0.0).mean()), float(end(temperature_degC))
            said.append(
                f"{100.0 * share:.0f} % of the samples are {word} than any run that the model was made from ({low:.0f} "
                f"to {high:.0f} degC; here {here:.0f} degC): the model is off by more there, the estimate follows the "
                "voltage less and its band is wider; fit the model to a run at that temperature too"
            )
    return said


def _run_answer(observed: Observation) -> dict[str, Any]:
    start = {"value": float(observed.smoothed.soc[0]), "std": float(observed.smoothed.soc_std[0])}
    return {
        "run": observed.name,
        **observed.figures,
        "alarms": observed.alarms,
        **observed.sensors,
        "smoothed": observed.smoothed_figures | {"initial_soc": start},
    }


def answer_of(observer: FuzzyObserver | ModuleObserver, observed: Sequence[Observation]) -> dict[str, Any]:
    """Return the `observe` object of the public contract over all runs.

    Errors of the state of charge are null where a run has no reference.
    """
    gain = (observer if isinstance(observer, FuzzyObserver) else observer.cell).settings.gain
    innovation_V = np.concatenate([each.innovation_V for each in observed])
    known = innovation_V[~np.isnan(innovation_V)]
    n = sum(len(each.time_s) for each in observed)
    return {
        "runs": [_run_answer(each) for each in observed],
        "innovation_rms_mV": 1e3 * float(np.sqrt(np.mean(known**2))) if len(known) else None,
        "us_per_step": 1e6 * sum(each.seconds for each in observed) / n,
        "gain": gain,
        "stability": _NOT_CERTIFIED[gain],
        "usability": observer.network.record.usability,
    }
