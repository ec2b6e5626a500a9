"""A bench's side of the sample link, for tests of the real recorder process."""

import selectors
import socket
from pathlib import Path
from typing import Any

import numpy as np

from bench_service.framing import recv_frame, send_frame
from bench_service.store.reading import StreamData
from bench_service.store.samples import SampleReader
from bench_service.streams import OBSERVER, SAMPLES, STREAMS, Columns, layout_to_json, pack
from tests.patience import PATIENCE_S


def columns(stream: str, seq0: int, n: int) -> Columns:
    """Return rows that anybody can make again from their sequence numbers."""
    seq = np.arange(seq0, seq0 + n)
    made = {c.name: (seq * 1.5 + i).astype(c.numpy) for i, c in enumerate(STREAMS[stream])}
    made["time_s"] = seq * 0.01
    return made


class Bench:
    """Sends rows as a control process does and hears what the recorder answers."""

    def __init__(self, link: socket.socket) -> None:
        link.settimeout(PATIENCE_S)
        self.link = link
        self.acked: dict[tuple[str, str], int] = {}
        self.sealed: dict[str, dict[str, Any]] = {}
        self.error: str | None = None
        self.at_end = False

    def open(self, run_id: str, *streams: str) -> None:
        layouts = {stream: layout_to_json(STREAMS[stream]) for stream in streams or (SAMPLES, OBSERVER)}
        send_frame(self.link, {"op": "open", "run_id": run_id, "streams": layouts})

    def rows(self, run_id: str, seq0: int, n: int, stream: str = SAMPLES) -> None:
        body = pack(STREAMS[stream], columns(stream, seq0, n))
        send_frame(self.link, {"op": "rows", "run_id": run_id, "stream": stream, "seq0": seq0, "n": n}, body)

    def close(self, run_id: str, state: str = "completed", reason: str | None = None) -> dict[str, Any]:
        """Close a run and return what the recorder says of it once it is sealed."""
        send_frame(self.link, {"op": "close", "run_id": run_id, "state": state, "reason": reason})
        while run_id not in self.sealed:
            self.hear()
            assert not self.at_end, self.error
        return self.sealed[run_id]

    def wait_ack(self, run_id: str, next_seq: int, stream: str = SAMPLES) -> None:
        while self.acked.get((run_id, stream), 0) < next_seq:
            self.hear()
            assert not self.at_end, self.error

    def hear(self) -> None:
        """Take one frame; the end of the link shows in `at_end`."""
        try:
            frame = recv_frame(self.link)
        except ConnectionResetError:
            frame = None
        if frame is None:
            self.at_end = True
            return
        match frame[0]["op"]:
            case "ack":
                self.acked[frame[0]["run_id"], frame[0]["stream"]] = frame[0]["next_seq"]
            case "sealed":
                self.sealed[frame[0]["run_id"]] = frame[0]
            case "error":
                self.error = frame[0]["reason"]
            case other:
                raise AssertionError(f"unexpected {other!r}")

    def hear_what_is_there(self) -> None:
        """Take the frames that have come in, without waiting for more."""
        with selectors.DefaultSelector() as selector:
            selector.register(self.link, selectors.EVENT_READ)
            while not self.at_end and selector.select(0):
                self.hear()


def check_rows(data: StreamData, stream: str, seq: np.ndarray) -> None:
    """Compare stored rows with those sent."""
    np.testing.assert_array_equal(data.seq, seq)
    for column in STREAMS[stream]:
        made = columns(stream, int(seq[0]), int(seq[-1] - seq[0]) + 1)[column.name][seq - seq[0]]
        np.testing.assert_array_equal(data.columns[column.name], made)


def stored(data_dir: Path, run_id: str, stream: str = SAMPLES) -> StreamData:
    """Return what another process sees of a run."""
    reader = SampleReader(data_dir)
    try:
        return reader.read(run_id, stream)
    finally:
        reader.close()
