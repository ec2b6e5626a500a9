"""Curves behind comparisons: simulated once in a worker, kept, and given part by part as fine as a picture needs."""

from __future__ import annotations

import asyncio
import json
from collections import OrderedDict
from collections.abc import Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench_service.jobs.modelling import plain
from bench_service.jobs.results import Curves
from bench_service.store.decimation import kept_rows

# About 32 bytes a row of memory, over all comparisons that are kept.
MOST_ROWS = 4_000_000
_MOST_POINTS = 200_000


@dataclass(frozen=True, slots=True)
class CurvePart:
    """Which part of a comparison's curves is wanted: ``from_s <= time_s <= to_s``, at most `points` of each run."""

    from_s: float | None = None
    to_s: float | None = None
    points: int = 2000


class ComparisonCurves:
    """Keeps the curves that were looked at last.

    Parameters
    ----------
    simulate : callable
        Gives the curves of a comparison by its id; takes seconds.
    """

    def __init__(self, simulate: Callable[[str], Coroutine[None, None, Sequence[Curves]]]) -> None:
        self._simulate = simulate
        self._kept: OrderedDict[str, asyncio.Task[Sequence[Curves]]] = OrderedDict()

    async def part(self, comparison_id: str, part: CurvePart) -> bytes:
        """Return a part as JSON, ``{"runs": [{"run_id", "time_s", "measured_V", "model_V", "residual_mV"}]}``."""
        if comparison_id not in self._kept:
            task = asyncio.create_task(self._simulate(comparison_id))
            task.add_done_callback(lambda done: self._settle(comparison_id, done))
            self._kept[comparison_id] = task
        self._kept.move_to_end(comparison_id)
        # Shared by all who ask meanwhile: the first one who gives up must not end it for the others.
        curves = await asyncio.shield(self._kept[comparison_id])
        return await asyncio.to_thread(as_json, curves, part)

    def _settle(self, comparison_id: str, done: asyncio.Task[Sequence[Curves]]) -> None:
        """Forget what has failed, and what was not looked at for longest where there is too much."""
        if done.cancelled() or done.exception() is not None:
            if self._kept.get(comparison_id) is done:
                del self._kept[comparison_id]
            return
        ended = [key for key, task in self._kept.items() if key != comparison_id and _stands(task)]
        while ended and sum(_rows(self._kept[key]) for key in [*ended, comparison_id]) > MOST_ROWS:
            del self._kept[ended.pop(0)]


def _stands(task: asyncio.Task[Sequence[Curves]]) -> bool:
    return task.done() and not task.cancelled() and task.exception() is None


def _rows(task: asyncio.Task[Sequence[Curves]]) -> int:
    return sum(len(curves.time_s) for curves in task.result())


def as_json(curves: Sequence[Curves], part: CurvePart) -> bytes:
    """Return a part of curves as JSON; fewer points of each run where there are many runs."""
    points = max(2, min(part.points, _MOST_POINTS // max(len(curves), 1)))
    runs = [_thinned(each, part, points) for each in curves]
    return json.dumps({"runs": plain(runs)}, allow_nan=False, separators=(",", ":")).encode()


def _thinned(curves: Curves, part: CurvePart, points: int) -> Mapping[str, object]:
    first = 0 if part.from_s is None else int(np.searchsorted(curves.time_s, part.from_s, "left"))
    last = len(curves.time_s) if part.to_s is None else int(np.searchsorted(curves.time_s, part.to_s, "right"))
    found = {name: values[first : max(first, last)] for name, values in curves.columns.items()}
    n = max(last - first, 0)
    rows = kept_rows(found, n, points, tuple(found))
    time_s = curves.time_s[first : first + n]
    return {"run_id": curves.run_id, "time_s": time_s[rows]} | {name: values[rows] for name, values in found.items()}
