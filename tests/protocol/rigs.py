"""A simulated cycler and the driver for it, over each transport; everything on this machine."""

from __future__ import annotations

import asyncio
import contextlib
import time
import uuid
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass
from typing import Any

from drivers.cycler import Cycler, DeviceLimits
from drivers.factory import open_cycler
from drivers.modbus_clients import set_timeout
from simulators.bench import SimulatorSettings, build_can_device, build_device
from simulators.can_bus import CanBusSettings
from simulators.can_node import CanNode
from simulators.modbus_server import ModbusServer
from simulators.rtu_server import RtuServer
from simulators.serial_line import SerialSettings
from tests.patience import FACTOR, PATIENCE_S
from tests.protocol.tcp_proxy import Proxy

LIMITS = DeviceLimits((2.5, 4.25), (-10.0, 10.0), (-10.0, 60.0), None)
TIMEOUT_S = 0.25  # where a test waits for silence; an answer that comes may take `PATIENT_S`
PATIENT_S = 30.0 * FACTOR
PERIOD_S = 0.1
FAST_LINE = SerialSettings(baud=921_600)
TRANSPORTS = ("modbus-tcp", "modbus-rtu", "can-virtual", "can-udp")


@dataclass
class Rig:
    """Device, what serves it, and a driver."""

    transport: str
    device: Any
    server: Any
    driver: Cycler
    address: str
    map_name: str
    lock_step: bool
    timeout_s: float = TIMEOUT_S
    proxy: Any = None  # of Modbus TCP, where there is one between driver and device
    port: str = ""  # of Modbus RTU

    async def acquired(self, limits: DeviceLimits = LIMITS, watchdog_s: float = 1.0) -> None:
        """Take control."""
        await self.driver.connect()
        await self.driver.acquire(limits, watchdog_s, PERIOD_S if self.lock_step else None)

    async def running(self, current_A: float = 2.0, limits: DeviceLimits = LIMITS, watchdog_s: float = 1.0) -> Any:
        """In the middle of a pulse."""
        await self.acquired(limits, watchdog_s)
        await self.driver.output(True)
        await self.driver.sample()
        await self.driver.apply(current_A)
        return await self.driver.sample()

    async def settled(self, current_A: float) -> Any:
        """Sample until the device has taken a set-point over, which it does in its next measuring period."""
        async with asyncio.timeout(PATIENCE_S):
            while abs((reading := await self.driver.sample()).current_A - current_A) > 0.02:
                await asyncio.sleep(0.005)
        return reading

    def another(self, options: str = "") -> Cycler:
        """One more driver for the same device."""
        return open_cycler(self.address + options, self.map_name, PATIENT_S)

    @contextlib.contextmanager
    def impatient(self) -> Iterator[None]:
        """Let the driver wait `timeout_s` for an answer, as a test of silence wants, while this is open."""
        link: Any = self.driver._link  # pyright: ignore[reportAttributeAccessIssue]
        _wait_at_most(link, self.timeout_s)
        try:
            yield
        finally:
            _wait_at_most(link, PATIENT_S)

    @property
    def at_rest(self) -> bool:
        """Whether output and set-point are off in the device itself."""
        return not self.device.cycler.output_on and self.device.cycler.set_point_A == 0.0


def _wait_at_most(link: Any, timeout_s: float) -> None:
    wire = getattr(link, "_connection", link)  # of Modbus; a CAN link waits itself
    wire._timeout_s = timeout_s
    if getattr(wire, "_client", None) is not None:
        set_timeout(wire._client, timeout_s)


@contextlib.asynccontextmanager
async def rig(
    transport: str,
    *,
    lock_step: bool = True,
    map_name: str = "",
    timeout_s: float = TIMEOUT_S,
    proxied: bool = False,
    line: SerialSettings = FAST_LINE,
    options: str = "",
    now: Callable[[], float] = time.monotonic,
    **settings: Any,
) -> AsyncIterator[Rig]:
    """Serve a simulated cycler and make a driver for it; `options` are added to the address, `now` is its clock."""
    is_can = transport.startswith("can")
    name = map_name or ("generic_can" if is_can else "generic")
    made = SimulatorSettings(map_name=name, lock_step=lock_step, **settings)
    device: Any
    server: Any
    proxy, port = None, ""
    if is_can:
        bus = CanBusSettings()
        if transport == "can-virtual":
            bus = CanBusSettings(interface="virtual", channel=uuid.uuid4().hex)
        device = build_can_device(made, now=now)
        server = CanNode(device, bus)
        address = await server.start()
    elif transport == "modbus-rtu":
        device = build_device(made, now=now)
        server = RtuServer(device, line)
        port = await server.start()
        address = f"modbus-rtu://{port}?baud={line.baud}"
    else:
        device = build_device(made, now=now)
        server = ModbusServer(device)
        tcp_port = await server.start("127.0.0.1", 0)
        if proxied:
            proxy = Proxy(tcp_port)
            tcp_port = await proxy.start()
        address = f"modbus-tcp://127.0.0.1:{tcp_port}"
    driver = open_cycler(address + options, name, PATIENT_S)
    try:
        yield Rig(transport, device, server, driver, address, name, lock_step, timeout_s, proxy, port)
    finally:
        await driver.close()
        if proxy is not None:
            await proxy.stop()
        await server.close()
