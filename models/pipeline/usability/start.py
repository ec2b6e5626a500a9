"""States of charge at the start of the runs that nothing but somebody's word stands for."""

from __future__ import annotations

import numpy as np

from models.comparison.start import Start
from models.data.timeseries import TimeSeries
from models.pipeline.training import Training
from models.pipeline.usability.reason import Reason, limited

# A rest has settled where what the voltage has still to go, at most three times what it went in the last minute, is
# less than what 1 % of charge makes on a curve that rises by half a volt.
_REST_S, _STILL_TO_COME, _SETTLED_V = 60.0, 3.0, 5e-3
# Full and empty are where a charger and a cut-off voltage say so.
_FULL, _EMPTY = 0.99, 0.01


def soc_on_trust(data: Training) -> list[Reason]:
    """Whether no run says by itself, or through whoever stated it, where on the scale of charge it begins."""
    both = zip(data.runs, data.starts, strict=True)
    if any(_is_anchored(run, start, data.cell.rest_A) for run, start in both):
        return []
    return [
        limited(
            "the state of charge at the start is taken on trust: no run begins with a rest, has a reference, or comes "
            "with a statement of how sure it is; all of the model's states of charge are off by as much as it is. "
            "Let a run begin with a rest of ten minutes, or from full, or give --initial-soc-std"
        )
    ]


def _is_anchored(run: TimeSeries, start: Start, rest_A: float) -> bool:
    if start.soc_std is not None or start.initial_soc >= _FULL or start.initial_soc <= _EMPTY:
        return True
    # One value is a statement; a column is a reference, kept by something that counts.
    if run.soc_ref is not None and int((~np.isnan(run.soc_ref)).sum()) > 1:
        return True
    return begins_settled(run, rest_A)


def begins_settled(run: TimeSeries, rest_A: float) -> bool:
    """Whether a run begins at rest and its voltage has come to stand there."""
    loaded = np.abs(np.nan_to_num(run.current_A, nan=np.inf)) > rest_A
    n = int(np.argmax(loaded)) if loaded.any() else len(run)
    if n < 3 or run.time_s[n - 1] - run.time_s[0] < _REST_S:
        return False
    time_s = run.time_s[:n] - run.time_s[n - 1]
    last = (time_s >= -_REST_S) & ~np.isnan(run.voltage_V[:n])
    if last.sum() < 2:
        return False
    slope_V_per_s = float(np.polyfit(time_s[last], run.voltage_V[:n][last], 1)[0])
    return _STILL_TO_COME * abs(slope_V_per_s) * _REST_S < _SETTLED_V
