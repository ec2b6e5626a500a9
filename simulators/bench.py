"""A simulated bench: devices and the protocol in front of them, served until cancelled or terminated."""

import asyncio
import contextlib
import signal
import threading
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import replace

from drivers.register_map import map_kind
from simulators.bench_devices import build_can_device, build_device
from simulators.bench_settings import PROTOCOLS, SimulatorSettings
from simulators.can_device import CanDevice
from simulators.can_node import CanNode
from simulators.cell import TruthCell
from simulators.chamber import Chamber
from simulators.chamber_device import ChamberDevice
from simulators.chamber_server import chamber_alone, chamber_beside
from simulators.device import MapDevice
from simulators.fault_hooks import CanFaults, ModbusFaults
from simulators.faults import FaultEngine, parse_faults
from simulators.modbus_actions import OnRequest
from simulators.modbus_server import ModbusServer
from simulators.python_can import can
from simulators.rtu_server import RtuServer
from simulators.serial_line import SerialSettings

__all__ = ["PROTOCOLS", "SimulatorError", "SimulatorSettings", "build_can_device", "build_device", "serve"]

HOUSEKEEPING_S = 0.05


class SimulatorError(Exception):
    """The simulator cannot start; the message says why and what to do."""


async def serve(
    settings: SimulatorSettings,
    on_ready: Callable[[str], None],
    *,
    cell: TruthCell | None = None,
    on_request: OnRequest | None = None,
    on_chamber: Callable[[str], None] | None = None,
) -> None:
    """Serve a simulated bench, or a chamber where the map is of one, until cancelled or told to end by SIGTERM.

    Parameters
    ----------
    settings : SimulatorSettings
    on_ready : Callable
        Called once with the address, such as ``modbus-tcp://127.0.0.1:1502``, when clients can connect.
    cell : TruthCell, optional
        In place of the one that the settings name.
    on_request : Callable, optional
        Fault seam of `simulators.modbus_server.ModbusServer`.
    on_chamber : Callable, optional
        Called before `on_ready` with the address of the bench's chamber, where it has one.

    Raises
    ------
    SimulatorError
        If the address cannot be listened on, or the serial line not be opened.
    ValueError, drivers.register_map.BadMapError
        As `build_device`.
    """
    chamber = None if settings.chamber is None else Chamber(settings.chamber, settings.ambient_degC)
    devices, servers, address = await _start(settings, cell, on_request, chamber)
    try:
        if chamber is not None:
            device, server = chamber_beside(chamber, devices[0].poll)
            devices, servers = [*devices, device], [*servers, server]
            at = await _listen(server, settings.host, chamber.settings.port)
            if on_chamber is not None:
                on_chamber(at)
        async with _terminated() as stop:
            on_ready(address)
            while not stop.is_set():
                for device in devices:
                    device.poll()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(stop.wait(), HOUSEKEEPING_S)
    finally:
        for device in devices:
            device.rest()
        for server in servers:
            await server.close()


Started = tuple[Sequence[MapDevice | CanDevice | ChamberDevice], Sequence[ModbusServer | RtuServer | CanNode], str]


def _others(settings: SimulatorSettings) -> list[SimulatorSettings]:
    """Settings of the devices beside the first: other seeds, no faults."""
    return [replace(settings, seed=settings.seed + index, faults="") for index in range(1, settings.devices)]


async def _start_nodes(
    settings: SimulatorSettings, cell: TruthCell | None, engine: FaultEngine | None, chamber: Chamber | None
) -> Started:
    first = build_can_device(settings, cell=cell, engine=engine, chamber=chamber)
    nodes = [CanNode(first, settings.can, CanFaults(first.map, engine) if engine else None)]
    for index, other in enumerate(_others(settings), 1):
        bus = replace(nodes[0].settings, node=nodes[0].settings.node + index)
        nodes.append(CanNode(build_can_device(other), bus))
    try:
        addresses = [await node.start() for node in nodes]
    except (OSError, can.CanError) as error:
        raise SimulatorError(f"cannot join {nodes[0].address}: {error}; choose another --channel") from error
    return [node.device for node in nodes], nodes, addresses[0]


async def _start(
    settings: SimulatorSettings, cell: TruthCell | None, on_request: OnRequest | None, chamber: Chamber | None
) -> Started:
    """Build the devices, put the protocol in front of them; return both with the address that clients use."""
    engine = FaultEngine(parse_faults(settings.faults)) if settings.faults else None
    if settings.protocol == "can":
        return await _start_nodes(settings, cell, engine, chamber)
    if map_kind(settings.map_name) == "chamber":
        alone, server = chamber_alone(settings)
        return [alone], [server], await _listen(server, settings.host, settings.port)
    device = build_device(settings, cell=cell, engine=engine, chamber=chamber)
    if engine is not None:
        on_request = ModbusFaults(device.map, engine)
    others = [build_device(other) for other in _others(settings)]
    neighbours = {device.map.unit_id + index: other for index, other in enumerate(others, 1)}
    if settings.protocol == "modbus-rtu":
        server = RtuServer(device, settings.serial, on_request, neighbours)
        return [device, *others], [server], await _open_line(server, settings.serial)
    server = ModbusServer(device, on_request, neighbours)
    return [device, *others], [server], await _listen(server, settings.host, settings.port)


async def _open_line(server: RtuServer, line: SerialSettings) -> str:
    try:
        name = await server.start()
    except OSError as error:
        raise SimulatorError(
            f"cannot open {line.device or 'a pseudo-terminal'}: {error.strerror or error}; choose another --device"
        ) from error
    options = "" if (line.parity, line.stopbits) == ("N", 1) else f"&parity={line.parity}&stopbits={line.stopbits}"
    return f"modbus-rtu://{name}?baud={line.baud}{options}"


async def _listen(server: ModbusServer, host: str, at: int) -> str:
    try:
        port = await server.start(host, at)
    except OSError as error:
        raise SimulatorError(
            f"cannot listen on {host}:{at}: {error.strerror or error}; choose another port, or 0 for a free one"
        ) from error
    return f"modbus-tcp://{host}:{port}"


@contextlib.asynccontextmanager
async def _terminated() -> AsyncIterator[asyncio.Event]:
    """Yield an event that SIGTERM sets; signals reach the main thread's loop alone."""
    stop = asyncio.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGTERM, stop.set)
    try:
        yield stop
    finally:
        loop.remove_signal_handler(signal.SIGTERM)
