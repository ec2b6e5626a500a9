"""One run through the observer, and how good its state of charge was."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.resampling import to_grid
from models.timeseries import FloatArray

if TYPE_CHECKING:
    from models.observer import FuzzyObserver
    from models.timeseries import TimeSeries


# An estimate has converged from the moment on after which its error stays below this.
CONVERGED_SOC = 0.03
_TWO_SIDED_95 = 1.959963984540054


@dataclass(frozen=True, slots=True)
class Observation:
    """Estimates of one run on the model's grid, all of shape (n,), and what they are worth.

    Attributes
    ----------
    figures : `soc_rmse`, `soc_max_error`, `soc_end_error`, `converged_after_s`, `coverage_95`; None without reference
    seconds : time the replay took
    """

    name: str
    time_s: FloatArray
    soc: FloatArray
    soc_std: FloatArray
    model_voltage_V: FloatArray
    innovation_V: FloatArray
    figures: dict[str, float | None]
    seconds: float


def observe(observer: FuzzyObserver, run: TimeSeries, soc: float, soc_std: float | None) -> Observation:
    """Replay a run.

    Parameters
    ----------
    observer : FuzzyObserver
    run : TimeSeries
    soc, soc_std : where the observer starts, fractions; `soc_std` None takes the observer's own
    """
    grid = to_grid(run, observer.dt_s)
    temperature_degC = grid.temperature_degC
    known = temperature_degC[~np.isnan(temperature_degC)]
    state = observer.initial(soc, soc_std, float(known[0]) if len(known) else 25.0)
    arrays = (grid.current_A, grid.voltage_V, temperature_degC)
    observer.replay(state, *(values[:1] for values in arrays))  # the first call may compile
    started = time.perf_counter()
    _, rows = observer.replay(state, *arrays)
    seconds = time.perf_counter() - started
    figures = soc_figures(grid.time_s, rows[:, 0], rows[:, 1], grid.soc_ref)
    return Observation(run.name, grid.time_s, rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3], figures, seconds)


def soc_figures(
    time_s: FloatArray, soc: FloatArray, soc_std: FloatArray, soc_ref: FloatArray | None
) -> dict[str, float | None]:
    """Judge estimates by a reference.

    Parameters
    ----------
    time_s, soc, soc_std : (n,)
    soc_ref : (n,) NaN where unknown, or None

    Returns
    -------
    dict
        `soc_rmse`, `soc_max_error` and `coverage_95` (share within 1.96 standard deviations) count from
        `converged_after_s` on, or the whole run where it never converges; all are None without a reference.
    """
    names = ("soc_rmse", "soc_max_error", "soc_end_error", "converged_after_s", "coverage_95")
    if soc_ref is None or np.isnan(soc_ref).all():
        return dict.fromkeys(names)
    known = ~np.isnan(soc_ref)
    error = soc[known] - soc_ref[known]
    off = np.flatnonzero(np.abs(error) >= CONVERGED_SOC)
    first = 0 if len(off) == 0 else int(off[-1]) + 1
    converged_after_s = None if first == len(error) else float(time_s[known][first] - time_s[0])
    counted = slice(0 if converged_after_s is None else first, None)
    inside = np.abs(error[counted]) <= _TWO_SIDED_95 * soc_std[known][counted]
    values = (
        float(np.sqrt(np.mean(error[counted] ** 2))),
        float(np.max(np.abs(error[counted]))),
        float(error[-1]),
        converged_after_s,
        float(np.mean(inside)),
    )
    return dict(zip(names, values, strict=True))
