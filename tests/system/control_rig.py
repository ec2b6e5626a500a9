"""A bench for tests of the control process: simulator, recorder and control process, each a real process."""

import asyncio
import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from bench_service.bench.chamber.settings import ChamberSettings
from bench_service.bench.direct.ticket import StopEndpoint
from bench_service.bench.limits import Limits
from bench_service.bench.listener import BenchStatus
from bench_service.bench.request import RunRequest
from bench_service.bench.settings import BenchSettings
from bench_service.bench.supervisor import BenchSupervisor
from bench_service.recorder.client import RecorderProcess
from drivers.cycler import Reading
from drivers.factory import open_cycler
from tests.patience import PATIENCE_S, holds, stretched

WIDE = Limits((2.5, 4.3), (-9.0, 9.0), (-20.0, 60.0), (0.0, 1.0), None, 1e6)
_SIMULATOR = """
import asyncio, sys
from simulators.bench import SimulatorSettings, serve
from simulators.chamber import ChamberSettings
from simulators.cycler import CyclerSettings
lock_step, port, soc, serial, faults = sys.argv[1:]
chamber = None if faults == "-" else ChamberSettings(faults=faults, ramp_K_per_min=60.0)
more = {"seed": 7, "port": int(port), "initial_soc": float(soc), "chamber": chamber}
more["cycler"] = CyclerSettings(serial=int(serial))
found = []
told = lambda address: print(address, *found, flush=True)
asyncio.run(serve(SimulatorSettings(lock_step=lock_step == "1", **more), told, on_chamber=found.append))
"""


class Simulator:
    """A simulated cycler in a process of its own."""

    def __init__(
        self,
        *,
        lock_step: bool,
        port: int = 0,
        initial_soc: float = 0.5,
        serial: int = 1,
        chamber_faults: str | None = None,
    ) -> None:
        command = [sys.executable, "-c", _SIMULATOR, str(int(lock_step)), str(port), str(initial_soc), str(serial)]
        command.append("-" if chamber_faults is None else chamber_faults)
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.url, _, self.chamber_url = self.process.stdout.readline().strip().partition(" ")
        assert self.url, "the simulator did not start"

    @property
    def port(self) -> int:
        return int(self.url.rsplit(":", 1)[1])

    def kill(self) -> None:
        self.process.kill()
        self.end()

    def end(self) -> None:
        self.process.terminate()
        self.process.wait(PATIENCE_S)
        assert self.process.stdout is not None
        self.process.stdout.close()


@dataclass
class Listener:
    """Keeps everything a supervisor tells."""

    states: list[BenchStatus] = field(default_factory=list)
    live: list[dict[str, Any]] = field(default_factory=list)
    events: list[dict[str, Any]] = field(default_factory=list)
    ended: list[dict[str, Any]] = field(default_factory=list)

    def on_state(self, bench: str, status: BenchStatus) -> None:
        self.states.append(status)

    def on_live(self, bench: str, live: dict[str, Any]) -> None:
        self.live.append(live)

    def on_event(self, bench: str, event: dict[str, Any]) -> None:
        self.events.append(event)

    def on_ended(self, bench: str, ended: dict[str, Any]) -> None:
        self.ended.append(ended)

    def codes(self, severity: str) -> list[str]:
        return [event["code"] for event in self.events if event["severity"] == severity]


@dataclass
class Rig:
    simulator: Simulator
    recorder: RecorderProcess
    supervisor: BenchSupervisor
    heard: Listener
    data_dir: Path

    async def until(self, condition: Callable[[], Any], what: str) -> None:
        try:
            await holds(condition, what)
        except AssertionError as error:
            raise AssertionError(f"{error}; events: {self.heard.events}") from None

    async def play(self, request: RunRequest) -> dict[str, Any]:
        """Play a run to its end."""
        self.begin(request)
        return await self.end_of(request.run_id)

    def begin(self, request: RunRequest) -> None:
        self.supervisor.start_run(request)

    async def running(self, time_s: float = 0.0) -> None:
        """Wait until the run is past `time_s`."""
        await self.until(
            lambda: any(live["run_id"] and live["time_s"] >= time_s for live in self.heard.live), "run in progress"
        )

    async def end_of(self, run_id: str) -> dict[str, Any]:
        await self.until(lambda: self.heard.ended, f"end of {run_id}")
        assert [ended["run_id"] for ended in self.heard.ended] == [run_id]
        return self.heard.ended[0]

    async def reading(self) -> Reading:
        """Read the cycler over a connection of the test's own."""
        cycler = open_cycler(self.simulator.url, "generic", 0.5)
        await cycler.connect()
        try:
            return await cycler.sample()
        finally:
            await cycler.close()

    async def output_is_off(self, within_s: float) -> Reading:
        """Wait for it; `within_s` is on a quiet machine."""
        began_s = time.monotonic()
        async with asyncio.timeout(PATIENCE_S):
            while (reading := await self.reading()).output_on:
                await asyncio.sleep(0.01)
        assert time.monotonic() - began_s < stretched(within_s)
        return reading


def settings(simulator: Simulator, **changes: Any) -> BenchSettings:
    made = BenchSettings("sim", simulator.url, "generic", WIDE)
    if simulator.chamber_url:
        chamber = ChamberSettings(simulator.chamber_url, "generic_chamber", (0.0, 50.0), timeout_s=0.5, lost_s=6.0)
        made = replace(made, chamber=chamber)
    return replace(made, **changes)


def request(
    time_s: list[float], current_A: list[float], *, dt_s: float = 0.1, run_id: str = "run-1", **changes: Any
) -> RunRequest:
    profile = np.asarray(time_s, float), np.asarray(current_A, float)
    return replace(RunRequest(run_id, dt_s, WIDE, 3.0, *profile, initial_soc=0.5), **changes)


@contextlib.asynccontextmanager
async def rig(
    data_dir: Path,
    *,
    lock_step: bool,
    initial_soc: float = 0.5,
    origins: tuple[str, ...] = (),
    chamber_faults: str | None = None,
    **changes: Any,
) -> AsyncIterator[Rig]:
    """Start everything, wait until the bench is idle, end everything by its own pid afterwards.

    With `chamber_faults`, which may be empty, the bench has a temperature chamber.
    """
    simulator = Simulator(lock_step=lock_step, initial_soc=initial_soc, chamber_faults=chamber_faults)
    recorder = RecorderProcess.start(data_dir, commit_period_s=0.2)
    heard = Listener()
    stop = StopEndpoint(data_dir, "sim", origins)
    supervisor = BenchSupervisor(settings(simulator, **changes), recorder.attach, heard, stop)
    bench = Rig(simulator, recorder, supervisor, heard, data_dir)
    try:
        await supervisor.start()
        await supervisor.wait_for("idle", timeout_s=PATIENCE_S)
        yield bench
    finally:
        await supervisor.close()
        recorder.stop()
        bench.simulator.end()


def send_signal(pid: int | None, number: signal.Signals) -> None:
    assert pid is not None
    os.kill(pid, number)


def free_port() -> int:
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return sock.getsockname()[1]
