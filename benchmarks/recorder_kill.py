"""Kills the recorder process again and again while it writes, and counts acknowledged rows that are lost.

``python benchmarks/recorder_kill.py [--kills 100] [--data DIR]``; ends with 1 where a row is lost or unreadable.
"""

import argparse
import os
import random
import selectors
import signal
import socket
import sys
import tempfile
import time
from pathlib import Path

from numbered_rows import LAYOUT, numbered, right_rows

from bench_service.framing import recv_frame, send_frame
from bench_service.recorder.client import RecorderProcess
from bench_service.store.samples import SampleReader
from bench_service.streams import SAMPLES, layout_to_json, pack

ROWS = 50
COMMIT_PERIOD_S = 0.05


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--data", type=Path, default=None)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        data_dir = arguments.data or Path(scratch)
        rng = random.Random(arguments.seed)
        results = [_kill_once(data_dir, f"kill-{i}", rng.uniform(0.1, 0.4)) for i in range(arguments.kills)]
    acked = sum(acked for acked, _ in results)
    lost = sum(lost for _, lost in results)
    print(f"{len(results)} kills, {acked} rows acknowledged, {lost} of them lost or changed")
    return 1 if lost or not acked else 0


def _kill_once(data_dir: Path, run_id: str, after_s: float) -> tuple[int, int]:
    """Return how many rows were acknowledged, and how many of these are not there."""
    recorder = RecorderProcess.start(data_dir, commit_period_s=COMMIT_PERIOD_S)
    with recorder.attach("bench") as link:
        send_frame(link, {"op": "open", "run_id": run_id, "streams": {SAMPLES: layout_to_json(LAYOUT)}})
        acked, sent, end = 0, 0, time.monotonic() + after_s
        while time.monotonic() < end:
            rows = {"op": "rows", "run_id": run_id, "stream": SAMPLES, "seq0": sent, "n": ROWS}
            send_frame(link, rows, pack(LAYOUT, numbered(sent, ROWS)))
            sent += ROWS
            acked = _last_ack(link, acked, wait=False)
        os.kill(recorder.pid, signal.SIGKILL)
        acked = _last_ack(link, acked, wait=True)
    recorder.kill()
    reader = SampleReader(data_dir)
    data = reader.read(run_id)
    reader.close()
    return acked, acked - int(right_rows(data)[:acked].sum())


def _last_ack(link: socket.socket, acked: int, *, wait: bool) -> int:
    with selectors.DefaultSelector() as selector:
        selector.register(link, selectors.EVENT_READ)
        while selector.select(None if wait else 0):
            try:
                frame = recv_frame(link)
            except ConnectionResetError:
                return acked
            if frame is None:
                return acked
            acked = frame[0].get("next_seq", acked)
    return acked


if __name__ == "__main__":
    sys.exit(main())
