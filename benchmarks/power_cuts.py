"""Power cuts: from the trace of a recorder's writes, what a disk holds at random moments, and what is readable of it.

    python -m benchmarks.power_cuts --cuts 300 --seed 1

A recorder and the metadata store write under strace (Debian's package); each row that is acknowledged, each run that
is sealed and each event that is stored is noted in the same trace. Then the power is cut at random calls, half of the
times on a disk that keeps only what was synced, half on one that keeps random pages of the rest. Lost: what was told
to be stored and is not there, or is other than it was. Unreadable: a store that no service can start with, or that is
damaged.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import select
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench_service.errors import StoreError
from bench_service.framing import recv_frame, send_frame
from bench_service.recorder.client import RecorderProcess
from bench_service.store import engine as engines
from bench_service.store.metadata import MetadataStore
from bench_service.store.sample_writer import SampleWriter
from bench_service.store.samples import SampleReader
from bench_service.streams import SAMPLES, layout_to_json, pack
from benchmarks.disk_replay import SYSCALLS, Disk, operations
from benchmarks.numbered_rows import LAYOUT, numbered, right_rows

ROWS, BATCH_PERIOD_S, COMMIT_PERIOD_S, BATCHES, PATIENCE_S = 40, 0.02, 0.1, 150, 30.0


def main() -> int:
    """Record once, cut, and print one JSON object; the exit code says whether nothing was lost or unreadable."""
    options = _arguments()
    if options.play is not None:
        return _play(options.play, options.runs)
    if shutil.which("strace") is None:
        print("error: strace is missing; install it (Debian, Ubuntu: apt-get install strace)", file=sys.stderr)  # noqa: T201
        return 2
    with tempfile.TemporaryDirectory(prefix="power-cuts-") as scratch:
        folder = Path(scratch)
        _record(folder, options.runs)
        answer = _cut(folder, options.cuts, random.Random(options.seed))
    print(json.dumps(answer))  # noqa: T201
    return int(bool(answer["lost"] or answer["unreadable"]))


# --- what is traced ----------------------------------------------------------------------------------------


def _record(folder: Path, runs: int) -> None:
    command = [sys.executable, "-m", "benchmarks.power_cuts", "--play", str(folder / "disk"), "--runs", str(runs)]
    strace = ["strace", "-f", "-y", "-xx", "-s", "99999999", "-e", f"trace={SYSCALLS}", "-o", str(folder / "trace")]
    subprocess.run([*strace, *command], check=True)


def _play(disk: Path, runs: int) -> int:
    """Write runs and events, and note what has been acknowledged."""
    disk.mkdir()
    notes = os.open(disk / "notes", os.O_CREAT | os.O_WRONLY)
    store = MetadataStore.open(disk / "data")
    recorder = RecorderProcess.start(disk / "data", commit_period_s=COMMIT_PERIOD_S)
    for number in range(runs):
        _play_run(recorder, store, notes, f"run-{number}")
    recorder.kill()
    store.close()
    return 0


def _play_run(recorder: RecorderProcess, store: MetadataStore, notes: int, run_id: str) -> None:
    with recorder.attach("bench") as link:
        send_frame(link, {"op": "open", "run_id": run_id, "streams": {SAMPLES: layout_to_json(LAYOUT)}})
        for batch in range(BATCHES):
            header = {"op": "rows", "run_id": run_id, "stream": SAMPLES, "seq0": batch * ROWS, "n": ROWS}
            send_frame(link, header, pack(LAYOUT, numbered(batch * ROWS, ROWS)))
            time.sleep(BATCH_PERIOD_S)
            _hear(link, notes, run_id, wait=False)
            if batch % 10 == 0:
                event = store.events.add("info", "note", f"{run_id} {batch}")
                _note(notes, {"event": event.id, "text": event.text})
        send_frame(link, {"op": "close", "run_id": run_id, "state": "completed", "reason": None})
        _hear(link, notes, run_id, wait=True)


def _hear(link: Any, notes: int, run_id: str, *, wait: bool) -> None:
    """Note what the recorder has acknowledged; with `wait`, until it has sealed the run."""
    while select.select([link], [], [], PATIENCE_S if wait else 0.0)[0]:
        frame = recv_frame(link)
        if frame is None:
            break
        header = frame[0]
        if header["op"] == "ack":
            _note(notes, {"run": run_id, "rows": header["next_seq"]})
        elif header["op"] == "sealed":
            _note(notes, {"run": run_id, "rows": header["n_samples"], "sha256": header["sha256"]})
            break


def _note(notes: int, what: dict[str, Any]) -> None:
    os.write(notes, (json.dumps(what) + "\n").encode())


# --- what is left ------------------------------------------------------------------------------------------


@dataclass
class Acknowledged:
    """What had been acknowledged at a moment."""

    rows: dict[str, int] = field(default_factory=dict)
    sealed: dict[str, str] = field(default_factory=dict)
    events: dict[int, str] = field(default_factory=dict)

    def note(self, text: bytes) -> None:
        """Take one line of the notes."""
        told = json.loads(text)
        if "event" in told:
            self.events[told["event"]] = told["text"]
        else:
            self.rows[told["run"]] = told["rows"]
        if "sha256" in told:
            self.sealed[told["run"]] = told["sha256"]


def _cut(folder: Path, cuts: int, rng: random.Random) -> dict[str, Any]:
    traced = list(operations(folder / "trace"))
    root = folder / "disk" / "data"
    first = next(k for k, each in enumerate(traced) if each.path.startswith(str(root)))
    moments = sorted(rng.randrange(first, len(traced) + 1) for _ in range(cuts))
    disk, known, done = Disk(root), Acknowledged(), 0
    answer: dict[str, Any] = {"cuts": 0, "calls": len(traced) - first, "acknowledged_rows": 0}
    answer |= {"lost": [], "unreadable": []}
    for number, moment in enumerate(moments):
        for operation in traced[done:moment]:
            disk.apply(operation)
            if operation.path.endswith("/notes") and operation.name == "write":
                known.note(operation.data)
        done = moment
        left = folder / "left"
        disk.after_cut(left, rng if number % 2 else None)
        answer["cuts"] += 1
        answer["acknowledged_rows"] += sum(known.rows.values())
        _judge(left, known, f"cut {number} at call {moment}", answer)
        shutil.rmtree(left)
    return answer


def _judge(left: Path, known: Acknowledged, where: str, answer: dict[str, Any]) -> None:
    try:
        MetadataStore.open(left).close()  # as a service starts
        SampleWriter.open(left).close()
        faults = [fault for file in left.glob("*.sqlite") for fault in engines.faults_of(file)]
        answer["unreadable"] += [f"{where}: {fault}" for fault in faults]
        with SampleReader(left) as reader:
            answer["lost"] += [f"{where}: {what}" for what in _lost_rows(reader, known)]
        with closing(MetadataStore.look(left)) as store:
            stored = {event.id: event.text for event in store.events.page(limit=100_000)}
        missing = {number for number, text in known.events.items() if stored.get(number) != text}
        answer["lost"] += [f"{where}: event {number}" for number in sorted(missing)]
    except StoreError as error:
        answer["unreadable"].append(f"{where}: {error}")


def _lost_rows(reader: SampleReader, known: Acknowledged) -> list[str]:
    lost = []
    for run_id, rows in known.rows.items():
        data = reader.read(run_id)
        right = right_rows(data)
        if data.n < rows or not right.all() or data.gaps:
            lost.append(f"{run_id}: {rows} rows acknowledged, {int(right.sum())} of {data.n} right, gaps {data.gaps}")
        closed = reader.closed(run_id) if run_id in known.sealed else None
        if run_id in known.sealed and (closed is None or closed.sha256 != known.sealed[run_id]):
            lost.append(f"{run_id}: sealed, now {closed}")
    return lost


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cuts", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--runs", type=int, default=4, help="runs that are written, 6000 rows each")
    parser.add_argument("--play", type=Path, help=argparse.SUPPRESS)
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
