"""Convergence against accuracy: what trusting the voltage more or less does to both, for those who choose by hand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.observer.filter.fuzzy_observer import FuzzyObserver
from models.observer.filter.settings import ObserverSettings
from models.observer.tuning.accuracy import soc_figures

# On what the voltage is trusted less by: noise and error of the model together.
FACTORS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
_STARTS_OFF = (-0.2, 0.2)


@dataclass(frozen=True)
class TradeOff:
    """One way to choose, judged over all runs and starts.

    Attributes
    ----------
    factor : on the standard deviations of noise and model error; 1 is as the settings are
    converged_after_s : median time until the SoC's error stays below 3 %; infinite where it mostly does not
    soc_rmse : RMS error of the SoC from then on
    coverage_95 : share of it in the 95 % band
    """

    factor: float
    converged_after_s: float
    soc_rmse: float
    coverage_95: float


def trade_off(observer: FuzzyObserver, runs: list[GridRun], factors: tuple[float, ...] = FACTORS) -> list[TradeOff]:
    """Observe runs with a known state of charge from 20 points above and below it, once for each factor.

    Raises
    ------
    ModelError
        No run has a reference.
    """
    known = [run for run in runs if run.soc_ref is not None and not np.isnan(run.soc_ref).all()]
    if not known:
        raise ModelError("convergence cannot be judged: no run has a reference state of charge")
    return [_judged(FuzzyObserver(observer.network, scaled(observer.settings, f)), known, f) for f in factors]


def scaled(settings: ObserverSettings, factor: float) -> ObserverSettings:
    """Return settings that trust the voltage less by a factor."""
    return replace(
        settings,
        voltage_std_V=factor * settings.voltage_std_V,
        quick_error_std_V=factor * settings.quick_error_std_V,
        slow_error_std_V=factor * settings.slow_error_std_V,
    )


def _judged(observer: FuzzyObserver, runs: list[GridRun], factor: float) -> TradeOff:
    times, squares, held = [], [], []
    for run in runs:
        reference = run.soc_ref
        assert reference is not None
        start = float(reference[~np.isnan(reference)][0])
        for off in _STARTS_OFF:
            state = observer.initial(float(np.clip(start + off, 0.0, 1.0)))
            _, rows = observer.replay(state, run.current_A, run.voltage_V, run.temperature_degC)
            figures = soc_figures(run.time_s, rows[:, 0], rows[:, 1], reference)
            after_s = figures["converged_after_s"]
            times.append(np.inf if after_s is None else after_s)
            squares.append((figures["soc_rmse"] or 0.0) ** 2)
            held.append(figures["coverage_95"] or 0.0)
    median = float(np.sort(times)[len(times) // 2])
    return TradeOff(factor, median, float(np.sqrt(np.mean(squares))), float(np.mean(held)))
