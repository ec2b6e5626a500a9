"""Runs as they are looked at: what was read of them stays in memory for a while, so that zooming reads no disk.

Only pictures come from here: files, fits and whole reads always go to the disk. A run that goes on is read as far as
it has grown; one that has ended is read, and held against its record, once.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench_service.store.integrity import Expected, damage_beside, damage_of
from bench_service.store.reading import StreamData
from bench_service.store.records import OPEN_RUN_STATES, RunRecord
from bench_service.store.samples import SampleReader
from bench_service.streams import SAMPLES, Columns

# About 100 bytes a row: the largest part of the memory that pictures may take.
MOST_ROWS = 2_000_000
_SECONDS_PER_HOUR = 3600.0
COUNTED = ("charge_Ah", "energy_Wh")


@dataclass(frozen=True, slots=True)
class View:
    """A stream of a run with the columns that are counted from it, and what is wrong with it.

    Attributes
    ----------
    data : StreamData
        Samples also have ``charge_Ah`` and ``energy_Wh``, counted from the first sample of the run on: a current is
        that of the interval that ends with it; a missing value counts as none. Positive is into the cell.
    damage : str or None
    """

    data: StreamData
    damage: str | None

    def part(self, from_s: float | None, to_s: float | None, after_seq: int | None) -> StreamData:
        """Return the rows with ``from_s <= time_s <= to_s`` that come after row `after_seq`."""
        data = self.data
        if data.n == 0:
            return data
        time_s = data.columns["time_s"]
        first = 0 if from_s is None else int(np.searchsorted(time_s, from_s, "left"))
        last = data.n if to_s is None else int(np.searchsorted(time_s, to_s, "right"))
        if after_seq is not None:
            first = max(first, int(np.searchsorted(data.seq, after_seq, "right")))
        last = max(first, last)
        columns = {name: values[first:last] for name, values in data.columns.items()}
        return replace(data, columns=columns, seq=data.seq[first:last])


@dataclass(slots=True)
class _Kept:
    """What is in memory of one stream; arrays have room to grow."""

    columns: Columns = field(default_factory=dict)
    seq: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    n: int = 0
    view: View = field(default_factory=lambda: View(StreamData.empty(), None))
    lock: threading.Lock = field(default_factory=threading.Lock)

    def append(self, data: StreamData, damage: Future[str | None]) -> View:
        """Take rows in behind those that are there, while somebody finds out what is wrong with them."""
        if self.n == 0:
            self._begin(data)
        else:
            self._go_on(data)
        columns = {name: values[: self.n] for name, values in self.columns.items()}
        layout = data.layout or self.view.data.layout
        self.view = View(StreamData(layout, columns, self.seq[: self.n], data.gaps), damage.result())
        return self.view

    def _begin(self, data: StreamData) -> None:
        self.columns, self.seq, self.n = dict(data.columns), data.seq, data.n
        if {"current_A", "voltage_V"} <= set(self.columns):
            self.columns |= {name: np.zeros(data.n) for name in COUNTED}
            _count(self.columns, 0, data.n)

    def _go_on(self, data: StreamData) -> None:
        fresh = int(np.searchsorted(data.seq, self.seq[self.n - 1], "right"))
        end = self.n + data.n - fresh
        if end > len(self.seq):
            # What others still look at is left as it is: they hold the old arrays.
            self.columns = {name: _grown(values, self.n, 2 * end) for name, values in self.columns.items()}
            self.seq = _grown(self.seq, self.n, 2 * end)
        for name, values in data.columns.items():
            self.columns[name][self.n : end] = values[fresh:]
        self.seq[self.n : end] = data.seq[fresh:]
        _count(self.columns, self.n - 1, end)
        self.n = end


class Views:
    """The runs that were looked at last; may be used from several threads.

    Parameters
    ----------
    reader : SampleReader
    most_rows : int
        Of all streams together; a longer one is read anew for each picture.
    """

    def __init__(self, reader: SampleReader, most_rows: int = MOST_ROWS) -> None:
        self._reader = reader
        self._most_rows = most_rows
        self._kept: OrderedDict[tuple[str, str, str], _Kept] = OrderedDict()
        self._lock = threading.Lock()

    def view(self, run: RunRecord, stream: str = SAMPLES) -> View:
        """Return a stream of a run as it is now; raises `StoreError` where the file cannot be read at all."""
        goes_on = run.state in OPEN_RUN_STATES
        # The end of a run, a repair and a change of its samples all show in its record.
        key = (run.id, stream, "" if goes_on else f"{run.n_samples} {run.sha256} {run.repaired_utc} {run.removed_utc}")
        with self._lock:
            kept = self._kept.setdefault(key, _Kept())
            self._kept.move_to_end(key)
        with kept.lock:
            # The count also tells that the file is gone, or is another one.
            if goes_on or kept.n == 0 or self._reader.n_rows(run.id, stream) != kept.n:
                view = self._read(run, stream, kept, goes_on)
            else:
                view = kept.view
        self._make_room(key, damaged=view.damage is not None)
        return view

    def _read(self, run: RunRecord, stream: str, kept: _Kept, goes_on: bool) -> View:
        if not goes_on:
            kept.n = 0
        from_s = float(kept.columns["time_s"][kept.n - 1]) if kept.n else None
        data, expected = self._reader.read(run.id, stream, from_s), Expected.of(run)
        # A hash of a million samples takes as long as counting their charge: both leave the interpreter to others.
        with ThreadPoolExecutor(1, thread_name_prefix="damage") as pool:
            if stream == SAMPLES and from_s is None:
                return kept.append(data, pool.submit(damage_of, expected, data))
            return kept.append(data, pool.submit(damage_beside, self._reader, expected, data))

    def _make_room(self, newest: tuple[str, str, str], *, damaged: bool) -> None:
        """Forget what was not looked at for longest where there is too much, and what is damaged at once."""
        with self._lock:
            for key in [k for k in self._kept if k[:2] == newest[:2] and (k != newest or damaged)]:
                del self._kept[key]
            while self._kept and sum(kept.n for kept in self._kept.values()) > self._most_rows:
                self._kept.popitem(last=False)


def _grown(values: NDArray[Any], n: int, room: int) -> NDArray[Any]:
    grown = np.empty(room, values.dtype)
    grown[:n] = values[:n]
    return grown


def _count(columns: Columns, first: int, end: int) -> None:
    """Go on counting charge and energy from row `first`, whose counts stand, to row `end`."""
    if COUNTED[0] not in columns or end - first < 2:
        return
    time_s, current_A, voltage_V = (columns[name][first:end] for name in ("time_s", "current_A", "voltage_V"))
    hours = np.diff(time_s)
    hours *= 1.0 / _SECONDS_PER_HOUR
    for name, rate in zip(COUNTED, (current_A[1:], current_A[1:] * voltage_V[1:]), strict=True):
        moved = rate * hours
        # A sum tells of any missing value at a tenth of what looking at each costs; such a sample moves nothing.
        if not np.isfinite(moved.sum()):
            moved[~np.isfinite(rate)] = 0.0
        moved[0] += columns[name][first]
        np.cumsum(moved, out=columns[name][first + 1 : end])
