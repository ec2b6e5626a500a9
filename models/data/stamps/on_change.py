"""Logs that are written when something changes: a value holds until the next one, not back to the last.

Cyclers that log sparsely write a row at the end of each step, so that a value holds back to the row before. A logger
that writes on change writes the first row of the new step instead, after a long time of nothing: taken to hold back,
the new current would have flowed all that time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.lost_samples import tick_s
from models.data.timeseries import TimeSeries

# A change of the current by this share of the largest; fewer of them tell no habit.
_CHANGE, _FEWEST = 0.1, 5
# Such a row comes so many times later than the next one follows. An even log has 1 (measured ones 1.1 at most), one
# that holds back below 1, logs on change of simulated cells 3 to 7: least on a flat curve, where the next row is late.
_LATER = 2.0


def written_on_change(run: TimeSeries) -> bool:
    """Whether rows with a new current come after long intervals, and are followed by short ones."""
    return len(_late_changes(run)[0]) > 0


def held_until_next(run: TimeSeries) -> TimeSeries:
    """Put a row in front of each late change, with the current that held until then and nothing else known."""
    late, short_s = _late_changes(run)
    if not len(late):
        return run

    def put(name: str, inserted: np.ndarray) -> np.ndarray | None:
        values = getattr(run, name)
        return None if values is None else np.insert(values, late, inserted)

    nothing = np.full(len(late), np.nan)
    rows = {name: put(name, nothing) for name in ("voltage_V", "temperature_degC", "ambient_degC", "soc_ref")}
    rows["time_s"] = put("time_s", run.time_s[late] - short_s)
    rows["current_A"] = put("current_A", run.current_A[late - 1])
    return replace(run, **rows)


def _late_changes(run: TimeSeries) -> tuple[np.ndarray, float]:
    """Rows with a new current after a long interval, and how long it took the new current to be written at most."""
    step, current = np.diff(run.time_s), np.nan_to_num(run.current_A)
    if tick_s(run.time_s) is not None:
        # Of intervals with lost samples the longer ones hold more changes: that is no habit.
        return np.zeros(0, np.int64), 0.0
    changed = np.flatnonzero(np.abs(np.diff(current)) > _CHANGE * float(np.abs(current).max(initial=0.0)))
    changed = changed[changed + 1 < len(step)]
    if len(changed) < _FEWEST:
        return np.zeros(0, np.int64), 0.0
    before, after = step[changed], step[changed + 1]
    if not np.median(before) > _LATER * np.median(after):
        return np.zeros(0, np.int64), 0.0
    short_s = float(np.median(after))
    late = np.flatnonzero((step > 1.5 * short_s) & (np.diff(current) != 0.0)) + 1
    return late, min(short_s, 0.5 * float(step[late - 1].min(initial=np.inf)))
