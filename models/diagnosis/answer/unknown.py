"""What an unexplained error depends on, found without a catalogue of effects."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.view import View
from models.network.signals import REST_C_RATE, held_sign

_BINS = 12
_LEAST_STRENGTH = 0.05
# Chance alone spreads the square of an error that hangs together over hundreds of samples about half as unevenly.
_LEAST_UNEVENNESS = 0.2


def depends_on(views: tuple[View, ...], error_V: FloatArray) -> tuple[tuple[str, float], ...]:
    """Share of the squared error that each variable alone predicts, the strongest first.

    No variable predicts an error that is as often positive as negative at the same place, as one of a wrong dynamic is.
    Then it is told where it is large: how unevenly its square lies over each variable.

    Parameters
    ----------
    views : runs with their samples
    error_V : (n,) over all of them

    Returns
    -------
    (variable, strength 0..1) pairs; those with next to no strength are left out.

    Notes
    -----
    Correlation ratio over bins of equal count, less what chance gives it; for the square, half the sum of differences
    between its shares in such bins and the shares of samples (total variation).
    """
    bins = {name: _bins(values) for name, values in _variables(views).items()}
    predicted = {name: _correlation_ratio(own, error_V) for name, own in bins.items()}
    uneven = {name: _unevenness(own, error_V) for name, own in bins.items()}
    found = [pair for pair in predicted.items() if pair[1] >= _LEAST_STRENGTH]
    found = found or [pair for pair in uneven.items() if pair[1] >= _LEAST_UNEVENNESS]
    return tuple(sorted(found, key=lambda pair: -pair[1]))


def _variables(views: tuple[View, ...]) -> dict[str, FloatArray]:
    def gathered(values: list[FloatArray]) -> FloatArray:
        return np.concatenate([each[view.index] for each, view in zip(values, views, strict=True)])

    variables = {
        "soc": gathered([view.soc for view in views]),
        "current_A": gathered([view.run.current_A for view in views]),
        "direction": gathered([held_sign(v.run.current_A, REST_C_RATE * v.capacity_Ah) for v in views]),
        "time_since_step_s": gathered([_since_step_s(view) for view in views]),
        "throughput_Ah": gathered([view.throughput_Ah for view in views]),
        "time_s": gathered([view.run.time_s for view in views]),
    }
    temperature = gathered([view.run.temperature_degC for view in views])
    if not np.isnan(temperature).any():
        variables["temperature_degC"] = temperature
    return variables


def _since_step_s(view: View) -> FloatArray:
    current = view.run.current_A
    step = np.abs(np.diff(current, prepend=current[:1])) > 2.0 * REST_C_RATE * view.capacity_Ah
    index = np.arange(len(current))
    return (index - np.maximum.accumulate(np.where(step, index, 0))) * view.run.dt_s


def _bins(values: FloatArray) -> np.ndarray:
    """(n,) number of the bin of equal count."""
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, _BINS + 1)))
    return np.searchsorted(edges[1:-1], values, side="right")


def _correlation_ratio(own: np.ndarray, error: FloatArray) -> float:
    count = np.bincount(own)
    if len(count) < 2:
        return 0.0
    sums = np.bincount(own, weights=error)
    between = float(np.sum(sums**2 / np.maximum(count, 1)))
    total = float(error @ error)
    chance = np.count_nonzero(count) / len(error)
    return float(np.clip(between / total - chance, 0.0, 1.0)) if total > 0.0 else 0.0


def _unevenness(own: np.ndarray, error: FloatArray) -> float:
    total = float(error @ error)
    if total == 0.0:
        return 0.0
    return 0.5 * float(np.abs(np.bincount(own, weights=error**2) / total - np.bincount(own) / len(own)).sum())
