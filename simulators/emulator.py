"""The other direction: a battery for power hardware and for tests of battery management systems.

The hardware tells the current that it measures, the emulator answers with voltage, temperature and state of charge in
real time: over Modbus TCP in registers, over CAN in the frames of a battery management system
(``drivers/maps/emulated_bms.dbc``). Which cell it is, a callable object says: a truth cell or an identified model.

Modbus, holding registers, most significant word first: 0 current in A (f32, written by the client); 10 voltage in V,
12 temperature in degC, 14 state of charge 0..1 (f32 each); 16 sequence (u32); 18 status (bit 0: no current was told
for a second, so 0 A is assumed; bit 1: state of charge outside 0..1).
"""

import asyncio
import contextlib
import math
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace

from drivers.register_map import MAPS
from simulators.can_bus import CanBusSettings, CanPort, free_udp_port
from simulators.can_dbc import read_dbc
from simulators.cell import CellOutput, TruthCell
from simulators.modbus_refusals import ILLEGAL_ADDRESS, ILLEGAL_VALUE, RefusedError
from simulators.modbus_server import ModbusServer
from simulators.python_can import can
from simulators.serial_line import WakeUp

__all__ = ["Battery", "EmulatorSettings", "PaceReport", "serve_battery"]

INPUT_AGE_S = 1.0
REGISTERS = 20
_CAN_INPUT = "PowerCurrent"


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatorSettings:
    """Where to serve the battery, and how often it answers.

    Attributes
    ----------
    protocol : str
        "modbus-tcp" or "can".
    host, port : str, int
        Of Modbus TCP.
    can : CanBusSettings
        Of CAN.
    rate_Hz : float
    seconds : float or None
        End after so long; None: never.
    cells_in_series : int
        For the mean cell voltage in the CAN frames.
    """

    protocol: str = "modbus-tcp"
    host: str = "127.0.0.1"
    port: int = 0
    can: CanBusSettings = CanBusSettings()
    rate_Hz: float = 100.0
    seconds: float | None = None
    cells_in_series: int = 1

    def __post_init__(self) -> None:
        """Check the settings once.

        Raises
        ------
        ValueError
            If the protocol is unknown or the rate impossible.
        """
        if self.protocol not in ("modbus-tcp", "can"):
            raise ValueError(f"unknown protocol {self.protocol!r}; choose modbus-tcp or can")
        if not 1.0 <= self.rate_Hz <= 2000.0:
            raise ValueError(f"rate is {self.rate_Hz} Hz; it must lie in 1..2000")


@dataclass(slots=True)
class PaceReport:
    """How punctual the emulator was: ticks, those that came too late to be played, and the worst delay in s."""

    ticks: int = 0
    missed: int = 0
    latest_s: float = 0.0


class Battery:
    """The emulated battery: takes a current, moves in time.

    Parameters
    ----------
    cell : TruthCell
    now : Callable
        Monotonic seconds.
    """

    def __init__(self, cell: TruthCell, now: Callable[[], float] = time.monotonic) -> None:
        self._cell, self._now = cell, now
        self._told_s = -math.inf
        self._told_A = 0.0
        self.sequence = 0
        self.seen: CellOutput = cell.step(0.0, 0.0)

    def tell(self, current_A: float) -> None:
        """Take the current that the power hardware measures.

        Raises
        ------
        ValueError
            If it is not finite.
        """
        if not math.isfinite(current_A):
            raise ValueError(f"current {current_A} A is no finite number")
        self._told_A, self._told_s = current_A, self._now()

    @property
    def stale(self) -> bool:
        """Whether nothing was told for too long."""
        return self._now() - self._told_s > INPUT_AGE_S

    @property
    def current_A(self) -> float:
        """The current that flows."""
        return 0.0 if self.stale else self._told_A

    def advance(self, dt_s: float) -> None:
        """Let time pass."""
        self.seen = self._cell.step(self.current_A, dt_s)
        self.sequence += 1


class _Registers:
    """The battery as a Modbus device."""

    def __init__(self, battery: Battery) -> None:
        self._battery = battery
        functions = frozenset((3, 16, 23))
        self.map = SimpleNamespace(unit_id=1, functions=functions, max_read_registers=125)

    def heard(self) -> None:
        """Nothing to do: the battery moves by its own clock."""

    def read(self, space: str, first: int, count: int) -> bytes:
        """Return the bytes of some registers."""
        if space != "holding" or first + count > REGISTERS:
            raise RefusedError(ILLEGAL_ADDRESS, f"no registers {first}..{first + count - 1}")
        battery, seen = self._battery, self._battery.seen
        status = battery.stale | (not 0.0 <= seen.soc <= 1.0) << 1
        image = struct.pack(
            ">f16xfffIHH",
            battery.current_A, seen.voltage_V, seen.temperature_degC, seen.soc, battery.sequence % (1 << 32), status, 0,
        )  # fmt: skip
        return image[2 * first : 2 * (first + count)]

    def write(self, first: int, data: bytes) -> None:
        """Take the current."""
        if first != 0 or len(data) != 4:
            raise RefusedError(ILLEGAL_ADDRESS, "only the current in registers 0..1 can be written")
        try:
            self._battery.tell(struct.unpack(">f", data)[0])
        except ValueError as error:
            raise RefusedError(ILLEGAL_VALUE, str(error)) from error


class _BmsNode:
    """The battery as a battery management system on CAN."""

    def __init__(self, battery: Battery, settings: CanBusSettings, cells_in_series: int) -> None:
        self._battery, self._cells = battery, cells_in_series
        self._layouts = read_dbc(MAPS / "emulated_bms.dbc")
        self._port = CanPort(settings, False, self._received)

    def publish(self) -> None:
        """Send the frames of this tick."""
        seen, battery = self._battery.seen, self._battery
        frames = {
            "BmsElectrical": {
                "Voltage": seen.voltage_V, "Current": battery.current_A, "StateOfCharge": seen.soc,
            },
            "BmsState": {
                "Temperature": seen.temperature_degC, "CellVoltage": seen.voltage_V / self._cells,
                "Sequence": battery.sequence % (1 << 24), "InputStale": float(battery.stale),
                "OutsideCharge": float(not 0.0 <= seen.soc <= 1.0),
            },
        }  # fmt: skip
        for name, values in frames.items():
            layout = self._layouts[name]
            self._port.send(layout.id, layout.encode(values), extended=layout.extended)

    def close(self) -> None:
        """Leave the bus."""
        self._port.close()

    def _received(self, message: can.Message) -> None:
        layout = self._layouts[_CAN_INPUT]
        ours = (message.arbitration_id, message.is_extended_id) == (layout.id, layout.extended)
        if ours and len(message.data) == layout.length and not message.is_error_frame:
            self._battery.tell(layout.decode(bytes(message.data))["Current"])


async def serve_battery(cell: TruthCell, settings: EmulatorSettings, on_ready: Callable[[str], None]) -> PaceReport:
    """Serve a battery in real time until the task is cancelled or its time is over.

    Parameters
    ----------
    cell : TruthCell
        E.g. an identified network.
    settings : EmulatorSettings
    on_ready : Callable
        Called once with the address, when clients can connect.

    Raises
    ------
    OSError, can.CanError
        If the address cannot be had.
    """
    battery, pace = Battery(cell), PaceReport()
    async with contextlib.AsyncExitStack() as stack:
        publish = await _serve(battery, settings, stack, on_ready)
        wake_up = WakeUp()
        stack.callback(wake_up.close)
        await _run(battery, settings, publish, wake_up, pace)
    return pace


async def _serve(
    battery: Battery,
    settings: EmulatorSettings,
    stack: contextlib.AsyncExitStack,
    on_ready: Callable[[str], None],
) -> Callable[[], None]:
    """Open the protocol; return what is to be called after each tick."""
    if settings.protocol == "can":
        bus = settings.can
        if bus.interface == "udp_multicast" and bus.port == 0:
            bus = replace(bus, port=free_udp_port())
        node = _BmsNode(battery, bus, settings.cells_in_series)
        stack.callback(node.close)
        port = f":{bus.port}" if bus.interface == "udp_multicast" else ""
        on_ready(f"can://{bus.interface}/{bus.channel}{port}")
        return node.publish
    server = ModbusServer(_Registers(battery))  # pyright: ignore[reportArgumentType]  # what the server needs of one
    stack.push_async_callback(server.close)
    port = await server.start(settings.host, settings.port)
    on_ready(f"modbus-tcp://{settings.host}:{port}")
    return lambda: None


async def _run(
    battery: Battery, settings: EmulatorSettings, publish: Callable[[], None], wake_up: WakeUp, pace: PaceReport
) -> None:
    period_s = 1.0 / settings.rate_Hz
    # Less by a hair: 0.07 s at 100 Hz are seven ticks, not the eight that rounding makes of the product.
    due = math.inf if settings.seconds is None else math.ceil(settings.seconds * settings.rate_Hz - 1e-9)
    start_s, tick = time.monotonic(), 0
    while tick < due:
        tick += 1
        await wake_up.until(start_s + tick * period_s)
        late_s = time.monotonic() - start_s - tick * period_s
        # Time does not stand still: the step is longer then, but never past the end that was asked for.
        skipped = int(min(late_s / period_s, due - tick))
        battery.advance((1 + skipped) * period_s)
        publish()
        tick += skipped
        pace.ticks, pace.missed = pace.ticks + 1, pace.missed + skipped
        pace.latest_s = max(pace.latest_s, late_s)
        await asyncio.sleep(0)
