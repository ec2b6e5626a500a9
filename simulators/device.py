"""A cycler seen through its device map: registers and coils in front, set-points and measurements behind."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

from drivers.register_map import DeviceMap, Register
from simulators.clocks import SimulatedClock
from simulators.cycler import Cycler, StateRefusedError, ValueRefusedError
from simulators.registers import RegisterCodec

__all__ = ["DEVICE_FAILURE", "ILLEGAL_ADDRESS", "ILLEGAL_VALUE", "MapDevice", "RefusedError"]

ILLEGAL_ADDRESS = 2
ILLEGAL_VALUE = 3
DEVICE_FAILURE = 4

_CURRENT_ROLES = frozenset(
    ("set_current", "actual_current", "setpoint_in_force", "limit_current_high", "limit_current_low")
)


class RefusedError(Exception):
    """A request that the device answers with a Modbus exception code."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code


@dataclass(slots=True)
class _Published:
    """A register that shows something of the cycler, where it stands, and the value that it shows."""

    codec: RegisterCodec
    getter: Callable[[], float]
    image: bytearray
    first: int
    value: float = math.nan


class MapDevice:
    """Register image of a cycler.

    Parameters
    ----------
    device_map : DeviceMap
        Says which register plays which role; registers without a role are plain memory.
    cycler : Cycler
    clock : SimulatedClock

    Notes
    -----
    A write is checked as a whole before any of it is taken over, then taken over in the order of the addresses, so
    that one message can carry set-point, heartbeat and lock-step tick.
    """

    state_refused = DEVICE_FAILURE  # the exception of a command that the device's state does not allow
    tells_refusals = True  # of set-points out of range; some devices answer as if they had taken them

    def __init__(self, device_map: DeviceMap, cycler: Cycler, clock: SimulatedClock) -> None:
        self.map = device_map
        self.cycler = cycler
        self.clock = clock
        s = cycler.settings
        constants = {
            "i_nom": s.nominal_current_A,
            "v_nom": s.nominal_voltage_V,
            "p_nom": s.nominal_current_A * s.nominal_voltage_V,
        }
        self._directions = {"set_charge": 0.0, "set_discharge": 0.0, "set_voltage": 0.0}
        if self.map.switch("remote") is None:
            cycler.set_remote(True)  # a device that takes commands whenever they come
        self._codecs = {name: RegisterCodec(reg, constants) for name, reg in device_map.registers.items()}
        self._writable = {
            (codec.register.space, codec.register.address): codec
            for codec in self._codecs.values()
            if codec.register.writable
        }
        self._image, self._block_end = _layout(device_map)
        one_type = (block for block in device_map.blocks if block.one_type)
        self._one_type = {(b.space, address) for b in one_type for address in range(b.first, b.last + 1)}
        self._heartbeat = 0.0
        self._bits = {role: self._bits_of(role) for role in ("status", "alarms")}
        current = device_map.by_role("actual_current")
        self._sink = current.negative if current else None  # flag that stands for the sign of an unsigned current
        self._published = self._bind_getters()
        self._setters = self._bind_setters()
        self._coils = {coil.address: coil for coil in device_map.coils.values()}
        self._plain_coils: dict[int, bool] = {}
        self._publish_fixed(constants)
        self.publish()

    def poll(self) -> None:
        """Let simulated time catch up with the clock."""
        if self.clock.poll(self.cycler):
            self.publish()

    def heard(self) -> None:
        """Catch up, then note that a client has sent a message."""
        self.poll()
        self.clock.heard()

    def rest(self) -> None:
        """Switch the output off, as a device does that is being shut down."""
        self.cycler.set_output(False)
        self.publish()

    def read(self, space: str, first: int, count: int) -> bytes:
        """Return the bytes of `count` registers.

        Raises
        ------
        RefusedError
            If they do not lie in one readable block of the map.
        """
        ends = self._block_end[space]
        if first >= len(ends) or first + count > ends[first]:
            raise RefusedError(ILLEGAL_ADDRESS, f"no readable block holds {space} {first}..{first + count - 1}")
        if (space, first) in self._one_type and len(self._types(space, first, count)) > 1:
            raise RefusedError(ILLEGAL_VALUE, f"{space} {first}..{first + count - 1} holds more than one type")
        return bytes(self._image[space][2 * first : 2 * (first + count)])

    def _types(self, space: str, first: int, count: int) -> set[str]:
        registers = self.map.registers.values()
        return {r.type for r in registers if r.space == space and first < r.end and r.address < first + count}

    def write(self, first: int, data: bytes) -> None:
        """Write whole values to holding registers, all or nothing.

        Raises
        ------
        RefusedError
            If an address is not writable or cuts through a value, a value is not finite or out of range, or the
            device's state does not allow it.
        """
        values = self._decoded(first, data)
        if self.map.single_writes and len(values) > 1:
            raise RefusedError(ILLEGAL_VALUE, "this device takes one register in a message")
        for codec, value in values:
            self._checked(codec.register, value)
        values = [(codec, value) for codec, value in values if self.tells_refusals or self._in_range(codec, value)]
        for codec, value in values:
            register = codec.register
            setter = self._setters.get(register.role or "")
            if setter is None:
                self._store(codec, value)
            else:
                setter(self._house_sign(register.role, value))
        self.publish()

    def read_coils(self, first: int, count: int) -> list[bool]:
        """Return `count` coils.

        Raises
        ------
        RefusedError
            If one of them is not in the map.
        """
        return [self._coil(address) for address in range(first, first + count)]

    def write_coils(self, first: int, values: list[bool]) -> None:
        """Write coils, all or nothing.

        Raises
        ------
        RefusedError
            If one of them is not writable, or the device's state does not allow it.
        """
        roles: dict[str, bool] = {}
        plain: dict[int, bool] = {}
        for address, value in enumerate(values, first):
            coil = self._coils.get(address)
            if coil is None or "w" not in coil.access:
                raise RefusedError(ILLEGAL_ADDRESS, f"coil {address} cannot be written")
            if coil.role is None:
                plain[address] = value
            else:
                roles[coil.role] = value
        self._command(roles)
        self._plain_coils |= plain
        self.publish()

    def publish(self) -> None:
        """Bring the image up to date with the cycler."""
        for entry in self._published:
            value = entry.getter()
            if value != entry.value or value == 0.0:  # NaN is never the same, and 0 may have changed its sign
                entry.value = value
                codec = entry.codec
                data = codec.encode(self._house_sign(codec.register.role, value))
                entry.image[entry.first : entry.first + codec.size] = data

    def _command(self, roles: Mapping[str, bool]) -> None:
        cycler = self.cycler
        alarms = bool(cycler.alarms) and not roles.get("clear_alarms", False)
        if roles.get("output", False):
            try:
                cycler.check_output(remote=roles.get("remote", cycler.remote), alarms=alarms)
            except StateRefusedError as error:
                raise RefusedError(self.state_refused, str(error)) from error
        if not alarms:
            cycler.alarms.clear()
        if "remote" in roles:
            cycler.set_remote(roles["remote"])
        if "output" in roles:
            cycler.set_output(roles["output"])

    def _coil(self, address: int) -> bool:
        coil = self._coils.get(address)
        if coil is None or "r" not in coil.access:
            raise RefusedError(ILLEGAL_ADDRESS, f"coil {address} cannot be read")
        states: dict[str | None, bool] = {
            "remote": self.cycler.remote,
            "output": self.cycler.output_on,
            "clear_alarms": False,
        }
        return states[coil.role] if coil.role in states else self._plain_coils.get(address, False)

    def _decoded(self, first: int, data: bytes) -> list[tuple[RegisterCodec, float]]:
        values: list[tuple[RegisterCodec, float]] = []
        offset = 0
        while offset < len(data):
            codec = self._writable.get(("holding", first + offset // 2))
            if codec is None or offset + codec.size > len(data):
                raise RefusedError(ILLEGAL_ADDRESS, f"no whole writable value at holding {first + offset // 2}")
            try:
                values.append((codec, codec.decode(data[offset : offset + codec.size])))
            except ValueError as error:
                raise RefusedError(ILLEGAL_VALUE, str(error)) from error
            offset += codec.size
        return values

    def _checked(self, register: Register, value: float) -> None:
        try:
            if register.role in ("set_current", "set_charge", "set_discharge"):
                turned = -value if register.role == "set_discharge" else value
                self.cycler.check_set_point(self._house_sign(register.role, turned))
            elif register.role == "output" and value:
                self.cycler.check_output(remote=self.cycler.remote, alarms=bool(self.cycler.alarms))
            elif register.role == "lock_step":
                self.clock.check_tick(int(value))
            elif register.role == "ramp" and value < 0.0:
                raise ValueRefusedError(f"ramp {value} A/s; it must be above 0, or 0 for none")
        except ValueRefusedError as error:
            if not self.tells_refusals:
                return
            raise RefusedError(ILLEGAL_VALUE, str(error)) from error
        except StateRefusedError as error:
            raise RefusedError(self.state_refused, str(error)) from error

    def _in_range(self, codec: RegisterCodec, value: float) -> bool:
        """Whether a device that tells of no refusal takes a value."""
        if codec.register.role not in ("set_charge", "set_discharge"):
            return True
        limits = self.cycler.limits
        return value <= (limits["current_high"] if codec.register.role == "set_charge" else -limits["current_low"])

    def _house_sign(self, role: str | None, value: float) -> float:
        return -value if role in _CURRENT_ROLES and self.map.positive_current == "discharge" else value

    def _store(self, codec: RegisterCodec, value: float | str) -> None:
        register = codec.register
        data = codec.encode(value)
        self._image[register.space][2 * register.address : 2 * register.address + codec.size] = data

    def _publish_fixed(self, constants: Mapping[str, float]) -> None:
        fixed: dict[str, float | str] = {self.map.identity.register: self.map.identity.equals[0]}
        fixed |= {register: constants[name] for name, register in self.map.constants.items() if name in constants}
        if "map_version" in self._codecs:
            fixed["map_version"] = 1
        for name, value in fixed.items():
            self._store(self._codecs[name], value)

    def _bind_getters(self) -> list[_Published]:
        cycler, clock = self.cycler, self.clock
        shared = self.map.by_role("status") is self.map.by_role("output")
        by_role: dict[str, Callable[[], float]] = {
            "sequence": lambda: cycler.sequence,
            "actual_voltage": lambda: cycler.measurement.voltage_V,
            "actual_current": self._actual_current,
            "temperature": lambda: cycler.measurement.temperature_degC,
            "ambient_temperature": lambda: cycler.measurement.ambient_degC,
            "set_current": lambda: cycler.requested_A,
            "set_charge": lambda: max(cycler.requested_A, 0.0),
            "set_discharge": lambda: max(-cycler.requested_A, 0.0),
            "set_voltage": lambda: self._directions["set_voltage"],
            "remote": lambda: float(cycler.remote),
            "output": lambda: float(_bit_sum(self._bits["status"], self._status()) if shared else cycler.output_on),
            "clear_alarms": lambda: 0.0,
            "setpoint_in_force": lambda: cycler.set_point_A,
            "status": lambda: _bit_sum(self._bits["status"], self._status()),
            "alarms": lambda: _bit_sum(self._bits["alarms"], cycler.alarms),
            "heartbeat": lambda: self._heartbeat,
            "lock_step": lambda: clock.tick,
            "lock_step_available": lambda: float(clock.lock_step),
            "lock_step_period": lambda: clock.period_s,
            "watchdog": lambda: cycler.watchdog_s,
            "ramp": self._ramp,
            "serial": lambda: cycler.settings.serial,
        }
        by_role |= {f"limit_{name}": partial(cycler.limits.__getitem__, name) for name in cycler.limits}
        codecs = self._codecs.values()
        return [
            _Published(c, by_role[c.register.role], self._image[c.register.space], 2 * c.register.address)
            for c in codecs
            if c.register.role in by_role
        ]

    def _bind_setters(self) -> Mapping[str, Callable[[float], None]]:
        cycler, clock = self.cycler, self.clock
        setters: dict[str, Callable[[float], None]] = {
            "set_current": cycler.set_current,
            "set_charge": partial(self._set_direction, "set_charge"),
            "set_discharge": partial(self._set_direction, "set_discharge"),
            "set_voltage": partial(self._set_direction, "set_voltage"),
            "remote": lambda on: self._command({"remote": bool(on)}),
            "output": lambda on: self._command({"output": bool(on)}),
            "clear_alarms": lambda on: self._command({"clear_alarms": bool(on)}),
            "heartbeat": self._beat,
            "lock_step": lambda tick: clock.move_to(int(tick), cycler),
            "lock_step_period": clock.set_period,
            "watchdog": self._set_watchdog,
            "ramp": self._set_ramp,
        }
        setters |= {f"limit_{name}": partial(cycler.set_limit, name) for name in cycler.limits}
        return MappingProxyType(setters)

    def _bits_of(self, role: str) -> Mapping[str, int]:
        register = self.map.by_role(role)
        return self.map.bits.get(register.name, {}) if register else {}

    def _actual_current(self) -> float:
        seen_A = self.cycler.measurement.current_A
        return abs(seen_A) if self._sink else seen_A

    def _set_direction(self, role: str, value: float) -> None:
        self._directions[role] = value
        if role != "set_voltage":
            self.cycler.set_current(self._directions["set_charge"] - self._directions["set_discharge"])

    def _status(self) -> frozenset[str]:
        status = self.cycler.status
        if self._sink and self.cycler.measurement.current_A < 0.0:
            status |= {self._sink}
        if self.cycler.alarms:
            status |= set(self.map.alarm_bits)
        return status | {"lock_step"} if self.clock.lock_step else status

    def _beat(self, value: float) -> None:
        self._heartbeat = value
        self.cycler.heartbeat()

    def _set_watchdog(self, time_s: float) -> None:
        self.cycler.watchdog_s = time_s
        self.cycler.heartbeat()

    def _ramp(self) -> float:
        ramp = self.cycler.ramp_A_per_s
        return self._unlimited_ramp() if ramp is None else ramp

    def _set_ramp(self, ramp_A_per_s: float) -> None:
        none = ramp_A_per_s in (0.0, self._unlimited_ramp())
        self.cycler.ramp_A_per_s = None if none else ramp_A_per_s

    def _unlimited_ramp(self) -> float:
        register = self.map.by_role("ramp")
        return register.unlimited or 0.0 if register else 0.0


def _bit_sum(bits: Mapping[str, int], names: frozenset[str] | set[str]) -> int:
    return sum(1 << bits[name] for name in names if name in bits)


def _layout(device_map: DeviceMap) -> tuple[dict[str, bytearray], dict[str, list[int]]]:
    """Return the empty image of each space, and for each address the end of the block that holds it (0: none)."""
    image: dict[str, bytearray] = {}
    ends: dict[str, list[int]] = {}
    for space in ("holding", "input"):
        registers = [reg for reg in device_map.registers.values() if reg.space == space]
        blocks = [(b.first, b.last + 1) for b in device_map.blocks if b.space == space]
        blocks = blocks or [(reg.address, reg.end) for reg in registers]
        size = max([end for _, end in blocks] + [reg.end for reg in registers], default=0)
        image[space] = bytearray(2 * size)
        ends[space] = [0] * size
        for first, end in blocks:
            ends[space][first:end] = [end] * (end - first)
    return image, ends
