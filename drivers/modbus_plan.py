"""A device map with the constants of one device put in: what does not change while it is connected."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Mapping, Sequence

from drivers.codec import bind_all, check_watchdog
from drivers.cycler import Capabilities, DeviceLimits
from drivers.device_map import LIMIT_ROLES, DeviceMap, Register
from drivers.errors import CyclerProtocolError, SetPointRefusedError
from drivers.expression import ExpressionError
from drivers.modbus_commands import CommandPlan, Commands, DirectionPlan, Write, contiguous
from drivers.modbus_sample import SamplePlan


class DevicePlan:
    """Everything about one connected device that does not change while it is connected.

    Raises
    ------
    CyclerProtocolError
        If the constants make a scale or a range unusable.
    """

    def __init__(self, device_map: DeviceMap, constants: Mapping[str, float]) -> None:
        self.map = device_map
        self.constants = constants
        self.codecs = bind_all(device_map, constants)
        self.sample = SamplePlan(device_map, self.codecs)
        make = DirectionPlan if device_map.has_directions else CommandPlan
        self.command: Commands = make(device_map, self.codecs)
        one = self.sample.reads[0] if len(self.sample.reads) == 1 else None
        # What function 23 can bring along with a command.
        self.one_message_read = one if one and one.space == "holding" and 23 in device_map.functions else None
        in_force = device_map.by_role("setpoint_in_force")
        self._in_force = self.codecs[in_force.name] if in_force else None

    def expected(self, current_A: float) -> tuple[float, float]:
        """Return what the device will report of a set-point, and how far it may be off by rounding, in A."""
        value_A = self.command.rounded(current_A)
        if self._in_force is None:
            return value_A, math.inf
        command = getattr(self.command, "codec", None)
        if command is None:
            return value_A, self._in_force.resolution(value_A)
        same = (self._in_force.type, self._in_force.factor, self._in_force.divisor)
        if same == (command.type, command.factor, command.divisor):
            return value_A, 0.0
        return value_A, max(command.resolution(value_A), self._in_force.resolution(value_A))

    async def stop_input(self, read: Callable[..., Awaitable[list[int]]]) -> bool | None:
        """Read whether the wired stop input is pressed; see `Cycler.stop_input`."""
        status = self.map.by_role("status")
        bit = None if status is None else self.map.bits.get(status.name, {}).get("stop_input")
        if status is None or bit is None:
            return None
        words = await read(status.space, status.address, status.words, f"'{status.name}'")
        return bool(int(self.codecs[status.name].decode(words)) >> bit & 1)

    def hold(self, voltage_V: float | None) -> list[Write]:
        """Messages that have the device hold a voltage, or none any more; empty where it has nothing to be told.

        Raises
        ------
        SetPointRefusedError
            The voltage is beyond what the device can hold, or it can hold none.
        """
        register = self.map.by_role("hold_voltage")
        if register is None or register.unlimited is None:
            if voltage_V is not None:
                raise SetPointRefusedError(f"map '{self.map.name}' has no voltage to hold; {voltage_V:g} V not sent")
            return []
        value = register.unlimited if voltage_V is None else voltage_V
        return [Write(register.address, self.codecs[register.name].encode(value), f"'{register.name}'")]

    def limit_values(self, limits: DeviceLimits) -> dict[str, float]:
        """Device limits by register name, for those registers that the map has."""
        sides = {
            "voltage": limits.voltage_V,
            "current": limits.current_A,
            "temperature": limits.temperature_degC,
        }
        values = {}
        for role in LIMIT_ROLES:
            _, quantity, side = role.split("_")
            if register := self.map.by_role(role):
                values[register.name] = sides[quantity][side == "high"]
        if ramp := self.map.by_role("ramp"):
            value = ramp.unlimited if limits.ramp_A_per_s is None else limits.ramp_A_per_s
            if value is not None:
                values[ramp.name] = value
        return values

    def grouped(self, values: Mapping[str, float]) -> list[Write]:
        """Messages that write some registers, those that lie together in one."""
        registers = sorted((self.map.registers[n] for n in values), key=lambda r: r.address)
        result = []
        for group, label in contiguous(registers, single=self.map.single_writes):
            words = tuple(word for r in group for word in self.codecs[r.name].encode(values[r.name]))
            result.append(Write(group[0].address, words, label))
        return result

    def check_watchdog(self, register: Register, watchdog_s: float) -> None:
        """Refuse a watchdog that is none, or a longer one, once it is rounded to the register's steps.

        Raises
        ------
        SetPointRefusedError
        """
        codec = self.codecs[register.name]
        written = codec.decode(codec.encode(watchdog_s))
        written_s = float(written) if isinstance(written, int | float) else math.nan
        check_watchdog(f"register '{register.name}'", watchdog_s, written_s, codec.resolution(watchdog_s))

    @property
    def heartbeat(self) -> Write | None:
        """The heartbeat's register, with a value still to be put in; None where the map does not have it read back."""
        register = self.map.by_role("heartbeat")
        if register is None or not register.readable or register.verify.kind != "readback":
            return None
        return Write(register.address, (0,) * register.words, f"'{register.name}'")

    def differences(self, write: Write, found: Sequence[int]) -> list[str]:
        """Say which registers of a message that was written read otherwise."""
        result = []
        for register in self.map.registers.values():
            first = register.address - write.first
            if register.space != "holding" or not register.readable or not 0 <= first < len(write.values):
                continue
            told, reads = write.values[first : first + register.words], tuple(found[first : first + register.words])
            if told != reads:
                values = (self.codecs[register.name].decode(words) for words in (reads, told))
                shown = [f"{value:g}" if isinstance(value, float | int) else repr(value) for value in values]
                unit = f" {register.unit}" if register.unit else ""
                result.append(f"'{register.name}' reads {shown[0]}{unit} where {shown[1]}{unit} was written")
        return result

    def capabilities(self, identity: Mapping[str, str], *, lock_step: bool) -> Capabilities:
        """What the device can do, by its map and its constants."""
        watchdog = self.map.by_role("watchdog")
        range_s = self.codecs[watchdog.name] if watchdog else None
        return Capabilities(
            name=self.map.title,
            **identity,
            current_A=self._interval("current", self.command.range_A),
            voltage_V=self._interval("voltage", (-math.inf, math.inf)),
            watchdog_s=(range_s.low, range_s.high) if range_s else None,
            lock_step=lock_step,
            has_sequence=self.sample.has_sequence,
            has_device_limits=all(self.map.by_role(role) for role in LIMIT_ROLES),
            has_ramp=self.map.by_role("ramp") is not None,
            has_hold=self.map.by_role("hold_voltage") is not None,
            has_temperature=self.map.by_role("temperature") is not None,
        )

    def _interval(self, name: str, otherwise: tuple[float, float]) -> tuple[float, float]:
        pair = self.map.capabilities.get(name)
        if pair is None:
            return otherwise
        try:
            return pair[0].evaluate(self.constants), pair[1].evaluate(self.constants)
        except ExpressionError as error:
            raise CyclerProtocolError(f"map {self.map.name}, capabilities.{name}: {error}") from None
