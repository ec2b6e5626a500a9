"""Where a protocol stands after a run that was cut off: the steps that ended are gone through again, without playing.

Every jump depends on what was known when a step ended, and that is stored with the step; so loops, cycles and jumps
come out as they were. The step that was cut off is counted from its samples, or from its own row where the run still
had the time to write it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench_service.protocol.counters import Counters, Ending
from bench_service.protocol.engine import Engine
from bench_service.protocol.laws import Seen
from bench_service.protocol.program import Program
from bench_service.protocol.state import Standing, StepEnd
from bench_service.streams import Flag

Columns = Mapping[str, NDArray[Any]]
_SUMS = ("charged_Ah", "discharged_Ah", "charged_Wh", "discharged_Wh")


def standing_after(program: Program, start: Standing | None, steps: Columns, samples: Columns) -> Standing | None:
    """Return where a protocol stands after one run of it; None: it had come to its end.

    Parameters
    ----------
    program : Program
    start : Standing or None
        Where that run had begun.
    steps, samples : columns
        What it has stored; empty where it has stored nothing.

    Raises
    ------
    ValueError
        The steps are not those of this program.
    """
    if not samples or not len(samples["time_s"]):
        return start or Standing(counters=[0] * program.n_counters)
    engine = Engine(program, 1.0, start)
    engine.begin(_seen_at(samples, 0))
    cut_off: Counters | None = None
    for k in range(len(steps["time_s"]) if steps else 0):
        end = _end_at(steps, k)
        if end.ended_by in (Ending.RUN_ENDED, Ending.LIMIT):
            cut_off = end.moved
        elif not engine.repeat(end):
            return None
        else:
            cut_off = None
    standing = engine.standing
    standing.step = cut_off or _counted(samples, standing)
    return standing


def _end_at(steps: Columns, k: int) -> StepEnd:
    row = {name: values[k].item() for name, values in steps.items()}
    moved = Counters(
        time_s=row["duration_s"],
        voltage_Vs=row["mean_voltage_V"] * row["duration_s"],
        **{name: row[name] for name in _SUMS},
    )
    soc = row["end_soc"]
    seen = Seen(
        row["end_voltage_V"], row["end_current_A"], row["end_temperature_degC"], None if np.isnan(soc) else soc, 0.0
    )
    ending = Ending(row["ended_by"])
    return StepEnd(row["step_count"], row["step_index"], row["cycle_count"], row["instruction"], ending, moved, seen)


def _seen_at(samples: Columns, k: int) -> Seen:
    values = (float(samples[name][k]) for name in ("voltage_V", "current_A", "temperature_degC"))
    return Seen(*values, soc=None, interval_s=0.0)


def _counted(samples: Columns, standing: Standing) -> Counters:
    """Count the step that was cut off: what it had moved before this run, and the samples that belong to it.

    Those that were taken while somebody held the run are passed over, as they were when it played.
    """
    moved = standing.step
    played = (samples["flags"] & Flag.PAUSED) == 0
    rows = np.flatnonzero((samples["step_count"] == standing.step_count) & played)
    times = samples["time_s"]
    for k in rows[rows > 0]:
        moved.count(float(samples["voltage_V"][k]), float(samples["current_A"][k]), float(times[k] - times[k - 1]))
    return moved
