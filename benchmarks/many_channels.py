"""Many channels and fast ones: 64 at 10 Hz into one recorder, one at 100 Hz beside a busy service.

    python -m benchmarks.many_channels --channels 64 --minutes 10
    python -m benchmarks.many_channels --fast-s 120

The channels are replayed streams: links to a real recorder, as control processes hold them, each with ten rows a second
of its own. Told: rows lost or changed, how late rows are acknowledged, memory of the recorder after the first and the
last minute, the largest write-ahead log; memory of a real control process, three of which stand beside. The fast one is
a whole bench over Modbus TCP, with clients that read samples and fits of the lowest priority on all processors.
"""

from __future__ import annotations

import argparse
import json
import select
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from bench_service.framing import recv_frame, send_frame
from bench_service.recorder.client import RecorderProcess
from bench_service.store.samples import SampleReader
from bench_service.streams import SAMPLES, layout_to_json, pack
from benchmarks.bench_rig import BENCH, ServiceProcess, ToldSimulator, children, command_of, table_of
from benchmarks.numbered_rows import LAYOUT, numbered, right_rows

ROWS, PERIOD_S = 10, 1.0
FAST_DT_S = 0.01
FIT = """
import os, numpy
os.nice(19)
matrix = numpy.random.default_rng(1).standard_normal((300, 300))
while True:
    numpy.linalg.svd(matrix)
"""


class Channel:
    """One replayed stream."""

    def __init__(self, number: int, link: socket.socket) -> None:
        self.run_id, self._link = f"channel-{number:02}", link
        self.sent = self.acknowledged = 0
        self._sent_at_s: dict[int, float] = {}
        self.delays_s: list[float] = []
        send_frame(link, {"op": "open", "run_id": self.run_id, "streams": {SAMPLES: layout_to_json(LAYOUT)}})

    def send(self) -> None:
        """Send the rows of one period."""
        header = {"op": "rows", "run_id": self.run_id, "stream": SAMPLES, "seq0": self.sent, "n": ROWS}
        send_frame(self._link, header, pack(LAYOUT, numbered(self.sent, ROWS)))
        self.sent += ROWS
        self._sent_at_s[self.sent] = time.monotonic()

    def hear(self) -> None:
        """Take the acknowledgements that have come."""
        while select.select([self._link], [], [], 0.0)[0]:
            frame = recv_frame(self._link)
            if frame is None:
                raise RuntimeError(f"{self.run_id}: the recorder is gone")
            if frame[0]["op"] == "ack":
                self.acknowledged = int(frame[0]["next_seq"])
                for sent in [sent for sent in self._sent_at_s if sent <= self.acknowledged]:
                    self.delays_s.append(time.monotonic() - self._sent_at_s.pop(sent))


def memory_MB(pid: int) -> float:
    """Memory that a process holds."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return round(int(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / 1024.0, 1)


def play_channels(n: int, minutes: float) -> dict[str, Any]:
    """Replay the channels; what was seen."""
    with tempfile.TemporaryDirectory(prefix="channels-") as folder, tempfile.TemporaryDirectory() as beside:
        benches = "".join(f"[bench.sim{k}]\nsimulate = {{ seed = {k} }}\n" for k in range(3))
        with ServiceProcess(Path(beside), benches) as service:
            time.sleep(5.0)
            pids = [pid for pid in children(service.process.pid) if "bench_service.bench " in command_of(pid)]
            bench_MB = [memory_MB(pid) for pid in pids]
            answer = _replay(Path(folder), n, minutes)
    return answer | {"control_process_MB": bench_MB}


def _replay(folder: Path, n: int, minutes: float) -> dict[str, Any]:
    recorder = RecorderProcess.start(folder)
    channels = [Channel(number, recorder.attach(f"bench{number}")) for number in range(n)]
    began_s, wal, memories = time.monotonic(), 0, list[float]()
    for period in range(round(60.0 * minutes / PERIOD_S)):
        for number, channel in enumerate(channels):
            due_s = began_s + (period + number / n) * PERIOD_S
            time.sleep(max(0.0, due_s - time.monotonic()))
            channel.send()
            channel.hear()
        wal = max(wal, *(file.stat().st_size for file in folder.glob("*-wal")), 0)
        if period % round(60.0 / PERIOD_S) == 0:
            memories.append(memory_MB(recorder.pid))
            print(f"{period * PERIOD_S / 60:.0f} min, recorder {memories[-1]} MB", file=sys.stderr)  # noqa: T201
    took_s = time.monotonic() - began_s
    time.sleep(3.0)
    for channel in channels:
        channel.hear()
    wrong = sum(_wrong(folder, channel) for channel in channels)
    recorder.kill()
    delays_ms = 1000.0 * np.concatenate([channel.delays_s for channel in channels])
    return {
        "channels": n,
        "minutes": round(took_s / 60.0, 2),
        "rows": sum(channel.sent for channel in channels),
        "lost_or_changed": wrong,
        "acknowledged_after_ms": [round(float(np.quantile(delays_ms, q))) for q in (0.5, 0.99, 1.0)],
        "recorder_MB": [memories[min(1, len(memories) - 1)], memories[-1]],
        "largest_wal_MB": round(wal / 2**20, 1),
    }


def _wrong(folder: Path, channel: Channel) -> int:
    with SampleReader(folder) as reader:
        data = reader.read(channel.run_id)
    return max(channel.sent, channel.acknowledged) - int(right_rows(data).sum())


def play_fast(duration_s: float) -> dict[str, Any]:
    """One bench at 100 Hz beside clients and fits; what was seen."""
    with tempfile.TemporaryDirectory(prefix="fast-") as folder, ToldSimulator("modbus-tcp") as simulator:
        with ServiceProcess(Path(folder), table_of(simulator.url, "modbus-tcp")) as service:
            service.until(lambda: service.idle(BENCH), "idle")
            fits = [subprocess.Popen([sys.executable, "-c", FIT]) for _ in range(2)]
            profile = service.client.upload_profile("steady", [0.0, duration_s], [1.0, 0.0])
            run = service.client.start_run(BENCH, profile["id"], FAST_DT_S, 0.5)["id"]
            stop = threading.Event()
            readers = [threading.Thread(target=_read, args=(service.address, run, stop)) for _ in range(3)]
            for reader in readers:
                reader.start()
            record = service.client.wait_run(run, timeout_s=duration_s + 120.0)
            stop.set()
            for process in fits:
                process.kill()
            requests_ms = _keep_alive_ms(service.address)
            late_ms = 1000.0 * np.array(service.client.samples(run, columns=["lateness_s"])["columns"]["lateness_s"])
    return {
        "dt_s": FAST_DT_S,
        "state": record["state"],
        "samples": record["n_samples"],
        "missed_ticks": record["missed_ticks"],
        "late_ms": [round(float(np.quantile(late_ms, q)), 2) for q in (0.5, 0.99, 0.999, 1.0)],
        "keep_alive_median_ms": requests_ms,
    }


def _read(address: str, run: str, stop: threading.Event) -> None:
    with httpx.Client(base_url=address, timeout=60.0) as client:
        while not stop.is_set():
            client.get(f"/api/v1/runs/{run}/samples", params={"points": 2000})
            client.get("/api/v1/benches")


def _keep_alive_ms(address: str) -> float:
    with httpx.Client(base_url=address, timeout=60.0) as client:
        took_s = []
        for _ in range(200):
            began_s = time.perf_counter()
            client.get("/healthz")
            took_s.append(time.perf_counter() - began_s)
    return round(1000.0 * float(np.median(took_s)), 2)


def main() -> int:
    """Measure, print one JSON object; the exit code says whether nothing was lost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--channels", type=int, default=64)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--fast-s", type=float, default=0.0, help="play the fast bench for so long instead")
    options = parser.parse_args()
    if options.fast_s:
        answer = play_fast(options.fast_s)
        print(json.dumps(answer))  # noqa: T201
        return int(answer["missed_ticks"] > 0.001 * answer["samples"])
    answer = play_channels(options.channels, options.minutes)
    print(json.dumps(answer))  # noqa: T201
    return int(bool(answer["lost_or_changed"]))


if __name__ == "__main__":
    raise SystemExit(main())
