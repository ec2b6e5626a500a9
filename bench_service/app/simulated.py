"""The simulator of a bench: started with the service, and again where it has ended by itself."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from bench_service.bench.listener import BenchListener
from bench_service.bench.messages import EventMessage
from bench_service.campaign.benches import Bench
from bench_service.campaign.standing import last_standing
from bench_service.config import ChamberConfig, SimulateConfig, SimulatedChamberConfig
from bench_service.simulation import SimulationError, SimulatorProcess
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import OPEN_RUN_STATES
from bench_service.store.samples import SampleReader

_FIRST_PAUSE_S, _LAST_PAUSE_S = 0.2, 10.0
_LOOK_S = 0.1
# For the run that it left: the link has to be given up, the last samples to be stored.
_RUN_ENDS_S = 30.0


def simulator_arguments(simulate: SimulateConfig, device_map: str, chamber: ChamberConfig | None = None) -> list[str]:
    """Write a simulated bench's configuration as arguments of `bench-service simulate`."""
    arguments = ["--protocol", simulate.protocol, "--map", device_map, "--cell", simulate.cell]
    arguments += ["--seed", str(simulate.seed), "--initial-soc", repr(simulate.initial_soc)]
    arguments += [f"--ambient-degC={simulate.ambient_degC!r}"]
    if simulate.protocol == "modbus-rtu":
        arguments += ["--baud", str(simulate.baud)]
    if simulate.faults:
        arguments += ["--faults", simulate.faults]
    if simulate.effects:
        arguments += ["--effects", ",".join(f"{name}={size!r}" for name, size in simulate.effects.items())]
    if chamber is not None and chamber.url is None:
        simulated = chamber.simulate or SimulatedChamberConfig()
        arguments += ["--chamber", chamber.map, "--chamber-ramp", repr(simulated.ramp_K_per_min)]
        arguments += ["--chamber-faults", simulated.faults] if simulated.faults else []
    if simulate.module is not None:
        arguments += ["--module", simulate.module]
    if simulate.capacity_Ah is not None:
        arguments += ["--capacity-Ah", repr(simulate.capacity_Ah)]
    return arguments + (["--lock-step"] if simulate.lock_step else ["--speed", repr(simulate.speed)])


def same_address(address: str) -> list[str]:
    """Arguments with which a simulator that is started again listens where the one before did."""
    scheme, _, rest = address.partition("://")
    place = rest.partition("?")[0]
    if scheme == "modbus-tcp":
        host, _, port = place.rpartition(":")
        return ["--host", host, "--port", port]
    return ["--device", place] if scheme == "modbus-rtu" else ["--channel", place]


class SimulatedCycler:
    """Keeps one simulator running; made by `start`.

    Attributes
    ----------
    address : where it listens, the same for as long as the service runs
    late : why it has no real-time priority, where it should
    chamber : where its temperature chamber listens, where it has one
    """

    def __init__(self, folder: TemporaryDirectory[str] | None, arguments: list[str], process: SimulatorProcess) -> None:
        self._folder = folder
        self._arguments = [*arguments, *same_address(process.address)]
        if process.chamber is not None:
            self._arguments += ["--chamber-port", process.chamber.rpartition(":")[2]]
        self._process = process
        self._keeping: asyncio.Task[None] | None = None
        self.address, self.late, self.chamber = process.address, process.late, process.chamber

    @classmethod
    async def start(cls, arguments: Sequence[str]) -> SimulatedCycler:
        """Start it; raises `SimulationError`."""
        # A pseudo-terminal has another name each time; the link to it stays.
        folder = TemporaryDirectory(prefix="bench-") if "modbus-rtu" in arguments else None
        line = [] if folder is None else ["--device", str(Path(folder.name) / "line")]
        try:
            return cls(folder, [*arguments, *line], await SimulatorProcess.start([*arguments, *line]))
        except SimulationError:
            if folder is not None:
                folder.cleanup()
            raise

    def keep(self, bench: Bench, store: MetadataStore, samples: SampleReader, listener: BenchListener) -> None:
        """Start it again from now on where it ends by itself; its cell then stands where the last run has left it."""
        self._keeping = asyncio.create_task(self._keep(bench, store, samples, listener))

    async def stop(self) -> None:
        """End it and wait for its end."""
        if self._keeping is not None:
            self._keeping.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._keeping
        await self._process.stop()
        if self._folder is not None:
            self._folder.cleanup()

    async def _keep(self, bench: Bench, store: MetadataStore, samples: SampleReader, listener: BenchListener) -> None:
        while True:
            await self._process.wait()
            await self._process.stop()
            _tell(listener, bench, "error", "the simulator has ended by itself; it is started again")
            soc = await _standing_soc(bench, store, samples)
            if soc is None:
                bench.runs_before_cell = await asyncio.to_thread(store.runs.last_number)
            await self._start_again([] if soc is None else ["--initial-soc", repr(soc)], bench, listener)
            where = "anew" if soc is None else f"where the last run has left it, at {100.0 * soc:.1f} %"
            _tell(listener, bench, "info", f"the simulator runs again; its cell begins {where}")

    async def _start_again(self, changed: list[str], bench: Bench, listener: BenchListener) -> None:
        pause_s, told = _FIRST_PAUSE_S, ""
        while True:
            try:
                self._process = await SimulatorProcess.start([*self._arguments, *changed])
                return
            except SimulationError as error:
                if str(error) != told:
                    told = str(error)
                    _tell(listener, bench, "error", told)
            await asyncio.sleep(pause_s)
            pause_s = min(2.0 * pause_s, _LAST_PAUSE_S)


async def _standing_soc(bench: Bench, store: MetadataStore, samples: SampleReader) -> float | None:
    """Count where the cell stands, once the run in which the simulator ended is over."""
    for _ in range(round(_RUN_ENDS_S / _LOOK_S)):
        newest = await asyncio.to_thread(store.runs.page, bench=bench.name, limit=1)
        if not newest or newest[0].state not in OPEN_RUN_STATES:
            break
        await asyncio.sleep(_LOOK_S)
    standing = await asyncio.to_thread(last_standing, bench, store, samples)
    return None if standing is None else standing.soc


def _tell(listener: BenchListener, bench: Bench, severity: str, text: str) -> None:
    event = EventMessage(severity=severity, code="simulator", text=f"bench {bench.name!r}: {text}", run_id=None)
    listener.on_event(bench.name, event)
