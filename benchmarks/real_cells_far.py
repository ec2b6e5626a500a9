"""Errors inside the trained ranges that are far too large, spell by spell, with what would explain each.

Used by `real_cells.py`.
"""

from typing import Any

import numpy as np

from models.comparison.simulated_runs import RunComparison, simulate_runs
from models.data.timeseries import FloatArray, TimeSeries
from models.network.cell_model import CellModel

Row = dict[str, Any]

# No more than 0.1 % of the errors inside the trained ranges may be larger.
FAR_V = 0.150
# Spells closer together than this are one, in s.
_APART_S = 600.0
# By so much of the capacity starts are moved to see how steep the voltage is.
_STEP = 0.002


def far_inside(
    model: CellModel, series: list[TimeSeries], soc: list[float], compared: list[RunComparison]
) -> list[Row]:
    """Spells of errors above `FAR_V` inside the trained ranges, the longest first.

    Parameters
    ----------
    model : simulates
    series, soc : judged runs and where they begin
    compared : what the model simulates of them

    Returns
    -------
    list of dict
        Of each spell: `run`, `from_s`, `to_s`, `samples`, `share` of all samples inside the trained ranges; ranges of
        `soc`, `current_A` and `temperature_degC`; `error_mV`, the mean; `mV_per_percent`, how steep the voltage is over
        the state of charge, and `slip_percent`, the share of the capacity by which the charge count would be off if all
        of the error came from it; `resistance_mOhm`, that would be missing if all came from one.
    """
    far = [c.inside & c.run.measured & (np.abs(np.nan_to_num(c.residual_V)) > FAR_V) for c in compared]
    if not any(each.any() for each in far):
        return []
    inside = sum(int((c.inside & c.run.measured).sum()) for c in compared)
    moved = simulate_runs(model, series, [min(start, 1.0 - _STEP) + _STEP for start in soc])
    held = simulate_runs(model, series, [min(start, 1.0 - _STEP) for start in soc])
    found: list[Row] = []
    for c, own, more, less in zip(compared, far, moved, held, strict=True):
        steep_V = (more.simulated_V - less.simulated_V) / _STEP
        found += [_spell(c, part, steep_V) | {"share": len(part) / inside} for part in _spells(c.run.time_s, own)]
    return sorted(found, key=lambda spell: -spell["samples"])


def _spells(time_s: FloatArray, far: np.ndarray) -> list[np.ndarray]:
    places = np.flatnonzero(far)
    if not len(places):
        return []
    return np.split(places, np.flatnonzero(np.diff(time_s[places]) > _APART_S) + 1)


def _spell(c: RunComparison, part: np.ndarray, steep_V: FloatArray) -> Row:
    run, error_V = c.run, c.residual_V[part]
    degC = run.temperature_degC[part]
    return {
        "run": run.name,
        "from_s": float(run.time_s[part[0]]),
        "to_s": float(run.time_s[part[-1]]),
        "samples": len(part),
        "soc": [float(c.soc[part].min()), float(c.soc[part].max())],
        "current_A": [float(run.current_A[part].min()), float(run.current_A[part].max())],
        "temperature_degC": None if np.isnan(degC).any() else [float(degC.min()), float(degC.max())],
        "error_mV": 1e3 * float(error_V.mean()),
        "mV_per_percent": 10.0 * float(steep_V[part].mean()),
        "slip_percent": 100.0 * _slope(steep_V[part], error_V),
        "resistance_mOhm": 1e3 * _slope(run.current_A[part], error_V),
    }


def _slope(signal: FloatArray, error_V: FloatArray) -> float:
    power = float(signal @ signal)
    return float(signal @ error_V) / power if power > 0.0 else 0.0
