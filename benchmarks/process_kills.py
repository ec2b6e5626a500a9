"""Kills (SIGKILL) each process of a bench at random moments of a run: nothing acknowledged is lost, nothing unsafe.

    python -m benchmarks.process_kills --kills 30 --seed 1 [--rows kills.rows] [--kinds control,recorder]

Kinds: the service, the control process, the recorder, a worker that fits, the simulator of the bench. A kill comes up
to three seconds after a run was asked for, so at its start too. What is wrong with one: the output on two seconds
later, a sample that a client had read before and is not there afterwards, rows that do not go on one by one, a run that
is not told as ended and why, a bench that does not come back once a person has acknowledged, a store that is not whole.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path

import httpx

from bench_service.client import ClientError
from benchmarks.bench_rig import BENCH, ServiceProcess, ToldSimulator, children, command_of, table_of
from benchmarks.row_file import Row, add_row, read_rows

KINDS = ("service", "control", "recorder", "worker", "simulator")
COMMANDS = {"control": "bench_service.bench ", "recorder": "bench_service.recorder", "worker": "spawn_main"}
SIMULATED = f"[bench.{BENCH}]\nsimulate = {{ seed = 3, lock_step = false }}\n"
FAST = "[bench.fast]\nsimulate = { seed = 4 }\n"
DT_S, OFF_WITHIN_S, PATIENCE_S, MOMENT_S = 0.05, 2.0, 90.0, (0.0, 3.0)
ENDS = {
    "service": {"interrupted"},
    "control": {"interrupted", "fault"},
    "recorder": {"interrupted", "fault"},
    "worker": {"stopped"},
    "simulator": {"fault"},
}


class Kills:
    """Kills of one kind against one service."""

    def __init__(self, kind: str, folder: Path, simulator: ToldSimulator | None, rng: random.Random) -> None:
        self.kind, self.simulator, self.rng = kind, simulator, rng
        cell = SIMULATED if simulator is None else table_of(simulator.url, "modbus-tcp")
        self.service = ServiceProcess(folder, cell + FAST)
        self._trained: str | None = None

    def once(self) -> Row:
        """Start a run, kill, look at what is left; the row of it."""
        self.service.until(lambda: self.service.idle(BENCH), "idle", PATIENCE_S)
        profile = self.service.client.upload_profile("steady", [0.0, 600.0], [1.0, 0.0])
        job = self._fit() if self.kind == "worker" else None
        run = self.service.client.start_run(BENCH, profile["id"], DT_S, 0.5)["id"]
        moment_s = self.rng.uniform(*MOMENT_S)
        time.sleep(moment_s)
        read = self._rows(run)
        killed_s = time.monotonic()
        there = self._kill()
        wrong = [] if there else ["there was nothing to kill"]
        off_s = self._output_off(killed_s, wrong) if self.kind != "worker" else None
        if self.kind == "service":
            self.service.start()
        self._judge_job(job, wrong)
        ended = self._judge_run(run, read, wrong)
        return {
            "kind": self.kind,
            "at_s": round(moment_s, 2),
            "read": read,
            "off_s": off_s,
            "state": ended.get("state"),
            "samples": ended.get("n_samples"),
            "wrong": wrong,
        }

    def _rows(self, run: str) -> int:
        with contextlib.suppress(ClientError):
            return self.service.client.samples(run, columns=["seq"])["n"]
        return 0

    def _fit(self) -> str:
        """Begin a fit that a worker is busy with for seconds; its job."""
        client = self.service.client
        if self._trained is None:
            self.service.until(lambda: client.bench("fast")["state"] == "idle", "the fast bench idle", PATIENCE_S)
            steps = [float(50 * k) for k in range(121)]
            profile = client.upload_profile("pulses", steps, [self.rng.choice((-2.0, 0.0, 2.0)) for _ in steps])
            run = client.wait_run(client.start_run("fast", profile["id"], 1.0, 0.5)["id"], timeout_s=PATIENCE_S)
            assert run["state"] == "completed", run
            self._trained = run["id"]
        body = {"name": "kills", "train": [self._trained], "capacity_Ah": 2.5, "structure": "auto"}
        job = httpx.post(f"{self.service.address}/api/v1/models", json=body, timeout=PATIENCE_S).json()["id"]
        self.service.until(lambda: client.job(job)["state"] == "running", "the fit has begun", PATIENCE_S)
        return job

    def _kill(self) -> bool:
        if self.kind == "service":
            self.service.kill()
            return True
        pids = children(self.service.process.pid)
        if self.kind == "simulator":
            guards = [pid for pid in pids if "bench_service.simulation" in command_of(pid)]
            told = json.dumps(self.service.client.bench(BENCH)["url"])
            found = [pid for guard in guards for pid in children(guard) if self._is_of(pid, told)]
        elif self.kind == "control":
            found = [pid for pid in pids if COMMANDS["control"] in command_of(pid) and BENCH in command_of(pid)]
        else:
            found = [pid for pid in pids if COMMANDS[self.kind] in command_of(pid)]
        for pid in found[:1]:
            os.kill(pid, signal.SIGKILL)
        return bool(found)

    @staticmethod
    def _is_of(pid: int, url: str) -> bool:
        """Whether a simulator is the one of the bench: it listens where the bench looks for it."""
        port = url.rsplit(":", 1)[1].strip('"')
        for sockets in ("tcp", "tcp6"):
            for line in Path(f"/proc/{pid}/net/{sockets}").read_text().splitlines()[1:]:
                fields = line.split()
                if fields[3] == "0A" and int(fields[1].rsplit(":", 1)[1], 16) == int(port):
                    return f"socket:[{fields[9]}]" in _files(pid)
        return False

    def _output_off(self, killed_s: float, wrong: list[str]) -> float | None:
        """Seconds until the output was off; None where it had not come on (or the device itself was killed)."""
        if self.simulator is None:
            return None
        end_s = killed_s + OFF_WITHIN_S
        while time.monotonic() < end_s and self.simulator.output_on:
            time.sleep(0.002)
        time.sleep(max(0.0, end_s - time.monotonic()))  # it must not come on again, or only now
        if self.simulator.output_on:
            wrong.append(f"output on {OFF_WITHIN_S} s after the kill")
        last_s = self.simulator.last_switched_s
        return None if last_s is None or last_s < killed_s else round(last_s - killed_s, 3)

    def _judge_job(self, job: str | None, wrong: list[str]) -> None:
        if job is None:
            return
        ended = self.service.until(
            lambda: (found := self.service.client.job(job))["state"] not in ("queued", "running") and found,
            "job ended",
            PATIENCE_S,
        )
        state = ended["state"]
        if state not in ("failed", "done"):
            wrong.append(f"job {state}")

    def _judge_run(self, run: str, read: int, wrong: list[str]) -> Row:
        client = self.service.client
        if self.kind == "worker":
            client.stop_run(run)
        ended = client.wait_run(run, timeout_s=PATIENCE_S)
        if ended["state"] not in ENDS[self.kind] or not (ended["reason"] and ended["ended_utc"]):
            wrong.append(f"run {ended['state']}, reason {ended['reason']!r}, ended {ended['ended_utc']}")
        kept = self.service.until(lambda: client.samples(run, columns=["seq"]), "samples", PATIENCE_S)
        in_a_row = kept["columns"].get("seq", []) == list(range(kept["n"]))
        if kept["n"] < read or not in_a_row or kept["n"] != ended["n_samples"]:
            wrong.append(f"{kept['n']} samples of {ended['n_samples']}, {read} had been read")
        self.service.until(lambda: self.service.idle(BENCH), "idle again", PATIENCE_S)
        return ended


def _files(pid: int) -> list[str]:
    found = []
    for each in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            found.append(os.readlink(each))
    return found


def verified(service: ServiceProcess) -> bool:
    """Whether all that is stored is whole."""
    command = [sys.executable, "-m", "bench_service.cli", "verify", "--config", str(service.config)]
    return os.spawnv(os.P_WAIT, sys.executable, command) == 0


def main() -> int:
    """Kill until each kind has its number; the exit code says whether nothing was wrong."""
    options = _arguments()
    rows = read_rows(options.rows)
    for kind in options.kinds:
        left = options.kills - sum(row["kind"] == kind for row in rows)
        if left <= 0:
            continue
        rng = random.Random(f"{options.seed} {kind} {left}")
        with tempfile.TemporaryDirectory(prefix="kills-") as folder, contextlib.ExitStack() as stack:
            simulator = None if kind == "simulator" else stack.enter_context(ToldSimulator("modbus-tcp"))
            kills = Kills(kind, Path(folder), simulator, rng)
            stack.enter_context(kills.service)
            for _ in range(left):
                rows.append(kills.once())
                add_row(options.rows, rows[-1])
                print(json.dumps(rows[-1]), file=sys.stderr, flush=True)  # noqa: T201
            if not verified(kills.service):
                rows.append({"kind": kind, "wrong": ["the store is not whole"], "off_s": None})
                add_row(options.rows, rows[-1])
    for kind in options.kinds:
        mine = [row for row in rows if row["kind"] == kind]
        off_s = [row["off_s"] for row in mine if row["off_s"] is not None]
        states = sorted({str(row["state"]) for row in mine if row.get("state")})
        line = {"kind": kind, "kills": len(mine), "wrong": sum(bool(row["wrong"]) for row in mine)}
        print(json.dumps(line | {"states": states, "latest_off_s": max(off_s, default=None)}))  # noqa: T201
    return int(any(row["wrong"] for row in rows))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rows", type=Path)
    parser.add_argument("--kinds", type=lambda text: text.split(","), default=list(KINDS))
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
