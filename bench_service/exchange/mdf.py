"""ASAM MDF 4 measurement files by the package asammdf (LGPL-3.0-or-later), which is an optional extra.

One channel group holds a run: a channel for each column, named as everywhere in this project, over the time in s.
"""

from __future__ import annotations

import gc
import logging
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench_service.exchange.columns import choose_columns
from bench_service.exchange.errors import ExchangeError, RunFileError
from bench_service.exchange.format import Format, RawTable, RunTable

MAGIC = b"MDF     "
_TIME = "time_s"
_VERSION = "4.10"
_LARGEST_BYTES = 4 << 30
_HOW = "pip install 'bench-service[formats]'"
# Of the blocks of a file: what comes before a block's links, and where a header's link to the file's history stands.
_LINKS, _HEADER, _HISTORY = 24, 64, 1


@dataclass(frozen=True, slots=True)
class Channel:
    """A channel: its name, its unit as the file writes it, and (n,) values."""

    name: str
    unit: str
    values: NDArray[np.float64]


def read_channels(path: Path) -> list[Channel]:
    """Read every numeric channel of a file, the time of the measurement in s first, as `time_s`.

    Two channels of one name are both there, but for one that repeats the other's values.

    Of groups with unequal times those that hold the most channels are read: a value is never made between two others.

    Raises
    ------
    RunFileError
        The package is not installed, the file is damaged, or it has no channels of numbers.
    """
    # An optional extra; it takes 1 s.
    try:
        from asammdf import MDF
    except ImportError as error:
        raise RunFileError(
            f"{path}: is an MDF file, and the package asammdf is not installed: {_HOW}, or write its samples as CSV"
        ) from error
    found: list[list[Channel]] = []
    trouble = ""
    with _quietly():
        try:
            with MDF(str(path)) as file:
                found = _by_time(path, file)
        except RunFileError:
            raise
        except Exception as error:  # whatever a damaged file makes of the reader
            trouble = str(error).partition("\n")[0][:100] or type(error).__name__
        if trouble:
            gc.collect()  # what the package has half read is taken down here and not somewhere else
    if trouble:
        raise RunFileError(f"{path}: is not a readable MDF file: {trouble}")
    channels = max(found, key=len, default=[])
    if len(channels) < 2:
        raise RunFileError(f"{path}: holds no channels of numbers")
    return channels


@contextmanager
def _quietly() -> Iterator[None]:
    """Keep the package's own complaints about a damaged file to itself: that it cannot be read is said in one line."""
    log, former = logging.getLogger("asammdf"), sys.unraisablehook
    silent, log.disabled = log.disabled, True
    sys.unraisablehook = lambda _: None
    try:
        yield
    finally:
        log.disabled, sys.unraisablehook = silent, former


def _by_time(path: Path, file: Any) -> list[list[Channel]]:
    """Channels that share their times, each with them."""
    found: list[list[Channel]] = []
    size = 0
    for number, group in enumerate(file.groups):
        size += 8 * int(group.channel_group.cycles_nr) * len(group.channels)
        if size > _LARGEST_BYTES:
            raise RunFileError(f"{path}: holds {size // 8} numbers; write it as Parquet or CSV")
        time_s = np.asarray(file.get_master(number), np.float64)
        same = next((each for each in found if np.array_equal(each[0].values, time_s)), None)
        if same is None:
            same = [Channel(_TIME, "s", time_s)]
            found.append(same)
        master = file.masters_db.get(number)
        for place, channel in enumerate(group.channels):
            if place != master:
                signal = file.get(group=number, index=place)
                values = np.asarray(signal.samples)
                if values.ndim == 1 and values.dtype.kind in "fiub":
                    _add(same, Channel(channel.name, signal.unit or "", values.astype(np.float64)))
    return found


def _add(channels: list[Channel], new: Channel) -> None:
    for each in channels:
        if (each.name, each.unit) == (new.name, new.unit) and np.array_equal(each.values, new.values, equal_nan=True):
            return
    channels.append(new)


def _read(path: Path) -> RawTable:
    channels = read_channels(path)
    names = tuple(channel.name for channel in channels)
    chosen = choose_columns(str(path), names)
    return RawTable(names, {own: channels[names.index(name)].values for own, name in chosen.items()})


def _encode(run: RunTable) -> bytes:
    # An optional extra; it takes 1 s.
    try:
        from asammdf import MDF, Signal
    except ImportError as error:
        raise ExchangeError(f"an MDF file needs the package asammdf: {_HOW}") from error
    time_s = np.asarray(run.columns[_TIME], np.float64)
    signals = [
        Signal(samples=np.ascontiguousarray(values), timestamps=time_s, name=name, unit=_unit(name))
        for name, values in run.columns.items()
        if name != _TIME
    ]
    # A run of unknown date bears the beginning of Unix time, as a clock that was never set does.
    began = datetime.fromtimestamp(run.started_unix_s or 0.0, UTC)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "run.mf4")
        with MDF(version=_VERSION) as file:
            file.start_time = began
            file.append(signals, comment="bench-service")
            file.save(path, overwrite=True)
        return _dated(path.read_bytes(), began)


def _unit(name: str) -> str:
    """Unit at the end of a column's name, such as A of current_A; none where it has none."""
    head, _, unit = name.rpartition("_")
    return unit if head and (unit == "s" or not unit.islower()) else ""


def _dated(content: bytes, began: datetime) -> bytes:
    """Return the file with the run's date in place of that of its writing, so that equal runs are equal files.

    The file's history (blocks FH, chained from the header's second link) has the time at which it was written, after
    its two links, in ns.
    """
    out = bytearray(content)
    at = _address(out, _HEADER, _HISTORY)
    while at:
        out[at + _LINKS + 16 : at + _LINKS + 24] = int(began.timestamp() * 1e9).to_bytes(8, "little")
        at = _address(out, at, 0)
    return bytes(out)


def _address(content: bytearray, block: int, link: int) -> int:
    first = block + _LINKS + 8 * link
    return int.from_bytes(content[first : first + 8], "little")


def _recognise(head: bytes) -> bool:
    return head.startswith((MAGIC, b"UnFinMF "))


FORMAT = Format(
    name="mdf4",
    title="ASAM MDF 4 with this project's column names",
    suffix=".mf4",
    media_type="application/x-asam-mdf4",
    recognise=_recognise,
    read=_read,
    encode=_encode,
)
