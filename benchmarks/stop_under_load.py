"""From the press of stop to the output off, while the service is flooded, starved or stopped (bar: p99 of 100 ms).

    python -m benchmarks.stop_under_load --presses 100 [--rows stop.rows] [--loads fits,...] [--way WAY]

Each press ends a run of 10 Hz on a simulated cycler in a process of its own, whose clock tells when the output went
off. Ways: direct, which the page and `bench-service stop` try first (the control process's own port), wired (a button
at the cycler, seen with the next sample), service (through the API). With `--rows` a press that has been measured is
not measured again.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from bench_service.client import ClientError
from bench_service.stop_tickets import StopTicket, read_tickets
from benchmarks.bench_rig import BENCH, PATIENCE_S, PRESSED_S, ServiceProcess, ToldSimulator, table_of
from benchmarks.row_file import add_row, read_rows

LOADS = ("none", "json_flood", "uploads", "half_open", "descriptors", "fits", "api_stopped")
TRANSPORTS = ("modbus-tcp", "can")
DT_S = 0.1
HALF_OPEN = 1100
FEW_DESCRIPTORS = 64
_WARM_UP_S = 2.0


def main() -> int:
    """Measure, print a line for each load and one JSON object; the exit code says whether the bar is held."""
    options = _arguments()
    if options.load is not None:
        return _load(options.load, options.url)
    rows = read_rows(options.rows)
    for transport in options.transports:
        for load in options.loads:
            done = [
                row for row in rows if (row["transport"], row["load"], row["way"]) == (transport, load, options.way)
            ]
            for row in _measure(transport, load, options.way, options.presses - len(done)):
                rows.append(row)
                add_row(options.rows, row)
    table = [_line(rows, transport, load, options.way) for transport in options.transports for load in options.loads]
    for line in table:
        print(json.dumps(line))  # noqa: T201
    return int(any(line["failures"] or line["p99_ms"] > 100.0 for line in table))


def _of(rows: list[dict[str, Any]], *kind: str) -> list[dict[str, Any]]:
    return [row for row in rows if (row["transport"], row["load"], row["way"]) == kind]


def _line(rows: list[dict[str, Any]], transport: str, load: str, way: str) -> dict[str, Any]:
    mine = _of(rows, transport, load, way)
    off_ms = [1000.0 * row["off_s"] for row in mine if row["off_s"] is not None]
    return {
        "transport": transport,
        "load": load,
        "way": way,
        "presses": len(mine),
        "failures": len(mine) - len(off_ms),
        "median_ms": round(float(np.median(off_ms)), 1) if off_ms else None,
        "p99_ms": round(float(np.quantile(off_ms, 0.99)), 1) if off_ms else 1e9,
        "max_ms": round(max(off_ms), 1) if off_ms else None,
    }


def _measure(transport: str, load: str, way: str, presses: int) -> Iterator[dict[str, Any]]:
    if presses <= 0:
        return
    with tempfile.TemporaryDirectory(prefix="stop-") as folder, ToldSimulator(transport) as simulator:
        with ServiceProcess(Path(folder), table_of(simulator.url, transport)) as service:
            service.until(lambda: service.idle(BENCH), "idle")
            ticket = next(iter(read_tickets(service.data)))
            with _under(load, service.address):
                for _ in range(presses):
                    off_s, ended = _press(service, ticket, simulator, load, way)
                    yield {"transport": transport, "load": load, "way": way, "off_s": off_s, "ended": ended}


def _press(
    service: ServiceProcess, ticket: StopTicket, simulator: ToldSimulator, load: str, way: str
) -> tuple[float | None, str | None]:
    """Start a run, press, and give how long the output stayed on, and how the run ended."""
    client = service.client
    service.until(
        lambda: service.idle(BENCH), "idle"
    )  # a link may have failed on a busy machine, which is acknowledged
    profile = _insist(lambda: client.upload_profile("steady", [0.0, 600.0], [1.0, 0.0]))
    run = _insist(lambda: client.start_run(BENCH, profile["id"], DT_S, 0.5))
    simulator.await_output(True)
    time.sleep(0.3 + float(np.random.default_rng().uniform(0.0, DT_S)))
    with _at_the_press(service.process.pid, load):
        pressed_s = time.monotonic()
        try:
            if way == "wired":
                simulator.push_button()
            elif way == "direct":
                ticket.ask("stop", "benchmark")
            else:
                client.stop_bench(BENCH)
        except (OSError, ClientError):
            pass
        off_at_s = simulator.await_output(False)
    ended = _insist(lambda: client.wait_run(run["id"], timeout_s=PATIENCE_S))
    if way == "wired":
        time.sleep(2 * PRESSED_S)  # no run begins while the button is pressed
    return None if off_at_s is None else off_at_s - pressed_s, ended["state"]


@contextlib.contextmanager
def _at_the_press(pid: int, load: str) -> Iterator[None]:
    """What would keep a run from being started too is there only for the moment."""
    soft, hard = resource.prlimit(pid, resource.RLIMIT_NOFILE)
    if load == "api_stopped":
        os.kill(pid, signal.SIGSTOP)
    if load == "descriptors":
        resource.prlimit(pid, resource.RLIMIT_NOFILE, (FEW_DESCRIPTORS, hard))
    try:
        yield
    finally:
        if load == "api_stopped":
            os.kill(pid, signal.SIGCONT)
        resource.prlimit(pid, resource.RLIMIT_NOFILE, (soft, hard))


def _insist(call: Any) -> Any:
    """Ask a flooded service until it has answered."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return call()
        except ClientError:
            if time.monotonic() > end_s:
                raise
            time.sleep(0.1)


# --- the parts ---------------------------------------------------------------------------------------------


@contextlib.contextmanager
def _under(load: str, url: str) -> Iterator[None]:
    children = {"fits": os.cpu_count() or 1, "none": 0, "api_stopped": 0}.get(load, 1)
    loads = [_child("--load", load, "--url", url) for _ in range(children)]
    try:
        if loads:
            time.sleep(_WARM_UP_S)
        yield
    finally:
        for child in loads:
            child.kill()
            child.wait()


def _child(*arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "benchmarks.stop_under_load", *arguments], stdout=subprocess.DEVNULL)


def _load(load: str, url: str) -> int:
    """Flood until killed."""
    if load == "fits":
        os.nice(19)
        matrix = np.random.default_rng(1).standard_normal((300, 300))
        while True:
            np.linalg.svd(matrix)
    if load in ("half_open", "descriptors"):
        return _half_open(url)
    threads = [threading.Thread(target=_flood, args=(load, url)) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return 0


def _flood(load: str, url: str) -> None:
    if load == "json_flood":
        address, kind, body = "/api/v1/models/import", "application/json", b"[" + b"0.123456789," * 1_500_000 + b"1]"
    else:
        rows = "".join(f"{k * 0.5},1.0\n" for k in range(1_600_000))[:19_900_000].rpartition("\n")[0]
        address, kind, body = "/api/v1/profiles?name=long", "text/csv", f"time_s,current_A\n{rows}\n".encode()
    with httpx.Client(timeout=PATIENCE_S, trust_env=False) as client:
        while True:
            with contextlib.suppress(httpx.HTTPError):
                client.post(url + address, content=body, headers={"content-type": kind})


def _half_open(url: str) -> int:
    host, _, port = url.removeprefix("http://").partition(":")
    socks: list[socket.socket] = []
    while True:
        while len(socks) < HALF_OPEN:
            with contextlib.suppress(OSError):
                socks.append(socket.create_connection((host, int(port)), 1.0))
                socks[-1].sendall(b"POST /api/v1/profiles HTTP/1.1\r\nHost: ")
                socks[-1].setblocking(False)
        alive = []
        for sock in socks:
            try:
                if sock.recv(1) != b"":
                    alive.append(sock)
                    continue
            except BlockingIOError:
                alive.append(sock)
                continue
            except OSError:
                pass
            sock.close()
        socks = alive
        time.sleep(0.05)


def _arguments() -> Any:
    def names(text: str) -> list[str]:
        return text.split(",")

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--presses", type=int, default=100)
    parser.add_argument("--rows", type=Path)
    parser.add_argument("--loads", type=names, default=list(LOADS))
    parser.add_argument("--transports", type=names, default=list(TRANSPORTS))
    parser.add_argument("--way", choices=["direct", "service", "wired"], default="direct")
    parser.add_argument("--load", help=argparse.SUPPRESS)
    parser.add_argument("--url", help=argparse.SUPPRESS)
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
