"""A simulated cycler behind a real protocol, for the tests of one process."""

from __future__ import annotations

import asyncio
import uuid
from typing import Any

from bench_service.pytest_plugin.background import Background
from simulators.bench import SimulatorSettings, build_can_device, build_device
from simulators.can_bus import CanBusSettings
from simulators.can_node import CanNode
from simulators.cycler import Cycler
from simulators.fault_hooks import CanFaults, ModbusFaults
from simulators.faults import FaultEngine, parse_faults
from simulators.modbus_server import ModbusServer
from simulators.rtu_server import RtuServer
from simulators.serial_line import SerialSettings

_POLL_S = 0.05


class EmulatedCycler:
    """A cycler that is not there, at a real address.

    Attributes
    ----------
    url, map_name : str
        What `drivers.factory.open_cycler` takes.
    cycler : Cycler
        The simulated device itself: its output, set-point, alarms, the truth behind the protocol.
    """

    def __init__(
        self, background: Background, protocol: str, map_name: str, faults: str, settings: SimulatorSettings
    ) -> None:
        self._background = background
        self._server: Any = None
        self._housekeeping: asyncio.Task[None] | None = None
        self.map_name = map_name
        self.url, self.cycler = background.run(self._start(protocol, faults, settings))

    async def _start(self, protocol: str, faults: str, settings: SimulatorSettings) -> tuple[str, Cycler]:
        engine = FaultEngine(parse_faults(faults))
        device: Any
        if protocol == "can":
            device = build_can_device(settings, engine=engine)
            bus = CanBusSettings(interface="virtual", channel=uuid.uuid4().hex)
            self._server = CanNode(device, bus, CanFaults(device.map, engine))
            self._housekeeping = asyncio.create_task(_polled(device))
            return await self._server.start(), device.cycler
        device = build_device(settings, engine=engine)
        self._housekeeping = asyncio.create_task(_polled(device))
        hook = ModbusFaults(device.map, engine)
        if protocol == "modbus-rtu":
            line = SerialSettings(baud=921_600)
            self._server = RtuServer(device, line, hook)
            return f"modbus-rtu://{await self._server.start()}?baud={line.baud}", device.cycler
        self._server = ModbusServer(device, hook)
        return f"modbus-tcp://127.0.0.1:{await self._server.start('127.0.0.1', 0)}", device.cycler

    def close(self) -> None:
        """Stop serving."""
        self._background.run(self._stop())

    async def _stop(self) -> None:
        if self._housekeeping is not None:
            self._housekeeping.cancel()
            await asyncio.gather(self._housekeeping, return_exceptions=True)
        await self._server.close()


async def _polled(device: Any) -> None:
    """Let the device notice by itself that its client is gone."""
    while True:
        await asyncio.sleep(_POLL_S)
        device.poll()
