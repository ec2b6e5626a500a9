"""A finished record into the store: its rows go over a sample link of their own, as a bench's do."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain

import numpy as np

from bench_service.errors import StoreError
from bench_service.framing import FramingError, Header, recv_frame, send_frame
from bench_service.streams import (
    CELLS,
    SAMPLES,
    STREAMS,
    Columns,
    Flag,
    cell_number,
    cells_layout,
    layout_to_json,
    pack,
)

_BATCH_ROWS = 20_000
_MOST_ON_THE_WAY = 200_000
_ANSWER_S = 60.0
_MISSING = {
    "voltage_V": Flag.VOLTAGE_MISSING,
    "current_A": Flag.CURRENT_MISSING,
    "temperature_degC": Flag.TEMPERATURE_MISSING,
}


@dataclass(frozen=True, slots=True)
class Sealed:
    """What the recorder says of a run that is stored: how many samples, and their content hash."""

    n_samples: int
    sha256: str


def feed(link: socket.socket, run_id: str, blocks: Iterable[Columns]) -> Sealed:
    """Store a record as the samples of a run; blocks until it is on the disk.

    Parameters
    ----------
    link : socket
        As `RecorderProcess.attach` gives it; closed at the end.
    run_id : str
    blocks : iterable of mappings
        Own name -> (m,) of one stretch after the other; at least time_s, current_A, voltage_V.

    Raises
    ------
    StoreError
        The recorder is gone, or could not store it; the run is then closed as interrupted.
    """
    with link:
        link.settimeout(_ANSWER_S)
        try:
            return _Feed(link, run_id).run(blocks)
        except (OSError, FramingError) as error:
            raise StoreError(f"the run could not be stored: {error}; nothing of it counts") from error


class _Feed:
    def __init__(self, link: socket.socket, run_id: str) -> None:
        self._link, self._run_id = link, run_id
        self._sent = self._stored = 0
        self._sealed: Header | None = None

    def run(self, blocks: Iterable[Columns]) -> Sealed:
        blocks, layouts = iter(blocks), {SAMPLES: STREAMS[SAMPLES]}
        first = next(blocks, {})
        if names := [name for name in first if cell_number(name) is not None]:
            layouts[CELLS] = cells_layout(names)
        streams = {name: layout_to_json(layout) for name, layout in layouts.items()}
        send_frame(self._link, {"op": "open", "run_id": self._run_id, "streams": streams})
        for block in chain([first] if first else [], blocks):
            n = len(block["time_s"])
            for start in range(0, n, _BATCH_ROWS):
                part = {name: values[start : start + _BATCH_ROWS] for name, values in block.items()}
                count = len(part["time_s"])
                for stream, layout in layouts.items():
                    rows = _rows(part, self._sent) if stream == SAMPLES else part
                    header = {"op": "rows", "run_id": self._run_id, "stream": stream, "seq0": self._sent, "n": count}
                    send_frame(self._link, header, pack(layout, rows))
                self._sent += count
                while self._sent - self._stored > _MOST_ON_THE_WAY:
                    self._hear()
        send_frame(self._link, {"op": "close", "run_id": self._run_id, "state": "completed", "reason": None})
        while self._sealed is None:
            self._hear()
        return Sealed(int(self._sealed["n_samples"]), str(self._sealed["sha256"]))

    def _hear(self) -> None:
        frame = recv_frame(self._link)
        header: Header = {"op": "error", "reason": "the recorder is gone"} if frame is None else frame[0]
        if header["op"] == "ack" and header["stream"] == SAMPLES:
            self._stored = int(header["next_seq"])
        elif header["op"] == "sealed":
            self._sealed = header
        elif header["op"] == "error":
            with contextlib.suppress(OSError):
                self._link.close()
            raise StoreError(f"the run could not be stored: {header.get('reason')}")


def _rows(block: Columns, first: int) -> Columns:
    """All columns of the stream of samples: what the record does not know is missing, never zero."""
    n = len(block["time_s"])
    unknown = np.full(n, np.nan)
    flags = np.zeros(n, dtype=np.uint32)
    for name, flag in _MISSING.items():
        flags[np.isnan(block.get(name, unknown))] |= int(flag)
    rows: Columns = {
        "device_sequence": np.arange(first, first + n) % 2**32,
        "flags": flags,
        "lateness_s": np.zeros(n),
        "step_count": _counts(block.get("step_count"), n),
        "cycle_count": _counts(block.get("cycle_count"), n),
    }
    return {
        column.name: rows[column.name] if column.name in rows else block.get(column.name, unknown)
        for column in STREAMS[SAMPLES]
    }


def _counts(values: np.ndarray | None, n: int) -> np.ndarray:
    return np.zeros(n) if values is None else np.clip(np.nan_to_num(values), 0, 2**32 - 1)
