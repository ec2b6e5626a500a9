"""A device map with the constants of one device put in: what is read and written per tick, computed once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

from drivers.codec import BlockDecoder, Codec, Value, bind_all
from drivers.cycler import Capabilities, DeviceLimits, Reading
from drivers.device_map import COMMAND_ROLES, LIMIT_ROLES, SAMPLE_ROLES, SETPOINT_ROLES, DeviceMap, Register
from drivers.errors import CyclerProtocolError, SetPointRefusedError
from drivers.expression import ExpressionError
from drivers.read_plan import ReadPlan, plan_reads


@dataclass(frozen=True, slots=True)
class Write:
    """Consecutive registers that go out in one message."""

    first: int
    values: tuple[int, ...]
    label: str


class SamplePlan:
    """Reads that make one sample (one, where the map allows it), and how a `Reading` is made of them."""

    def __init__(self, device_map: DeviceMap, codecs: Mapping[str, Codec]) -> None:
        roles = {role: r for role in SAMPLE_ROLES if (r := device_map.by_role(role)) is not None}
        registers = list(roles.values())
        self.reads: tuple[ReadPlan, ...] = plan_reads(device_map, [r.name for r in registers])
        self._decoders = tuple(
            BlockDecoder(p.first, p.count, [(r.address, codecs[r.name]) for r in p.registers]) for p in self.reads
        )
        order = [r.name for p in self.reads for r in p.registers]
        # A missing role points at the NaN that is put behind the values.
        self._at = tuple(order.index(roles[role].name) if role in roles else -1 for role in SAMPLE_ROLES)
        self.has_sequence = "sequence" in roles
        self._status_bits = _bits_of_role(device_map, "status")
        self._alarm_bits = _bits_of_role(device_map, "alarms")
        current = device_map.by_role("actual_current")
        self._negative = current.negative if current else None
        self._alarming = frozenset(device_map.alarm_bits)
        self._names: dict[tuple[int, int], tuple[frozenset[str], frozenset[str]]] = {}

    def reading(self, monotonic_s: float, count: int, blocks: Sequence[Sequence[int]]) -> Reading:
        """Make a reading of the registers of all reads; `count` stands in for a sequence the map lacks."""
        values: list[Value] = []
        for decoder, registers in zip(self._decoders, blocks, strict=True):
            values += decoder.decode(registers)
        values.append(math.nan)
        sequence, voltage, current, temperature, ambient, in_force, status, alarms = (values[i] for i in self._at)
        key = (_whole(status, 0), _whole(alarms, 0))
        names = self._names.get(key)
        if names is None:
            named = _named(self._status_bits, key[0])
            names = (named, _named(self._alarm_bits, key[1]) | (named & self._alarming))
            if len(self._names) < 1024:  # a device that flips random bits must not fill the memory
                self._names[key] = names
        return Reading(
            monotonic_s,
            _whole(sequence, count),
            float(voltage),
            0.0 - float(current) if self._negative in names[0] else float(current),
            float(temperature),
            float(ambient),
            float(in_force),
            "output_on" in names[0],
            names[0],
            names[1],
        )


class Commands(Protocol):
    """What goes out with each tick."""

    heartbeat_modulus: int
    range_A: tuple[float, float]

    def writes(self, current_A: float, heartbeat: int, tick: int | None, voltage_V: tuple[float, float]) -> list[Write]:
        """Messages of one tick; `tick` is None on the wall clock, `voltage_V` the bench's limits.

        Raises
        ------
        SetPointRefusedError
            If the set-point is not finite or beyond the device's range: nothing is sent then.
        """
        ...

    def rounded(self, current_A: float) -> float:
        """What the device makes of a set-point."""
        ...

    def read_back(self, current_A: float, *, every: bool) -> list[Write]:
        """What set-point registers must read: those that the map says, or every one that can be read."""
        ...


class CommandPlan:
    """Set-point, heartbeat and lock-step tick in as few messages as they lie together, in this order."""

    def __init__(self, device_map: DeviceMap, codecs: Mapping[str, Codec]) -> None:
        found = [r for role in COMMAND_ROLES if (r := device_map.by_role(role)) is not None]
        self._register = {r.role: r for r in found}
        self.codec = codecs[self._register["set_current"].name]
        self.range_A = self.codec.low, self.codec.high
        heartbeat = self._register.get("heartbeat")
        self.heartbeat_modulus = 1 << (16 * heartbeat.words) if heartbeat else 1
        self._timed = _contiguous(found, single=device_map.single_writes)
        self._untimed = _contiguous([r for r in found if r.role != "lock_step"], single=device_map.single_writes)
        self._codecs = codecs

    def writes(self, current_A: float, heartbeat: int, tick: int | None, voltage_V: tuple[float, float]) -> list[Write]:
        """See `Commands`."""
        values = {"set_current": current_A, "heartbeat": heartbeat, "lock_step": tick or 0}
        result = []
        for group, label in self._untimed if tick is None else self._timed:
            words: tuple[int, ...] = ()
            for register in group:
                words += self._codecs[register.name].encode(values[register.role or ""])
            result.append(Write(group[0].address, words, label))
        return result

    def rounded(self, current_A: float) -> float:
        """See `Commands`."""
        return float(self.codec.decode(self.codec.encode(current_A)))

    def read_back(self, current_A: float, *, every: bool) -> list[Write]:
        """See `Commands`."""
        return _read_back([(self._register["set_current"], self.codec, current_A)], every=every)


class DirectionPlan:
    """A set-point for each direction of the current: the one that is not wanted goes to zero first.

    Where the device has a voltage set-point too, it is the bench's upper limit while charging and the lower one while
    discharging: beyond it the device holds the voltage instead of the current.
    """

    heartbeat_modulus = 1

    def __init__(self, device_map: DeviceMap, codecs: Mapping[str, Codec]) -> None:
        found = ((role, device_map.by_role(role)) for role in SETPOINT_ROLES)
        self._registers = {role: register for role, register in found if register is not None}
        self._codecs = {role: codecs[register.name] for role, register in self._registers.items()}
        discharge = self._codecs.get("set_discharge")
        self.range_A = -discharge.high if discharge else 0.0, self._codecs["set_charge"].high

    def writes(self, current_A: float, heartbeat: int, tick: int | None, voltage_V: tuple[float, float]) -> list[Write]:
        """See `Commands`."""
        return [
            Write(self._registers[role].address, self._codecs[role].encode(value), f"'{self._registers[role].name}'")
            for role, value in self._values(current_A, voltage_V)
        ]

    def _values(self, current_A: float, voltage_V: tuple[float, float]) -> list[tuple[str, float]]:
        low_A, high_A = self.range_A
        if not low_A <= current_A <= high_A:  # also false for NaN
            raise SetPointRefusedError(f"set-point {current_A:g} A is outside {low_A:g} .. {high_A:g} A; not sent")
        charging = current_A >= 0.0
        wanted, other = ("set_charge", "set_discharge") if charging else ("set_discharge", "set_charge")
        values = [(other, 0.0), ("set_voltage", voltage_V[charging]), (wanted, abs(current_A))]
        return [(role, value) for role, value in values if role in self._registers]

    def rounded(self, current_A: float) -> float:
        """See `Commands`."""
        codec = self._codecs["set_charge" if current_A >= 0.0 else "set_discharge"]
        return math.copysign(float(codec.decode(codec.encode(abs(current_A)))), current_A)

    def read_back(self, current_A: float, *, every: bool) -> list[Write]:
        """See `Commands`."""
        values = {"set_charge": max(current_A, 0.0), "set_discharge": max(-current_A, 0.0)}
        entries = [(self._registers[r], self._codecs[r], value) for r, value in values.items() if r in self._registers]
        return _read_back(entries, every=every)


def _read_back(entries: Sequence[tuple[Register, Codec, float]], *, every: bool) -> list[Write]:
    return [
        Write(register.address, codec.encode(value), f"'{register.name}'")
        for register, codec, value in entries
        if (every and register.readable) or (register.verify.kind == "readback" and register.verify.register is None)
    ]


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
        for group, label in _contiguous(registers, single=self.map.single_writes):
            words = tuple(word for r in group for word in self.codecs[r.name].encode(values[r.name]))
            result.append(Write(group[0].address, words, label))
        return result

    def capabilities(self, serial: str, *, lock_step: bool) -> Capabilities:
        """What the device can do, by its map and its constants."""
        watchdog = self.map.by_role("watchdog")
        range_s = self.codecs[watchdog.name] if watchdog else None
        return Capabilities(
            name=self.map.title,
            serial=serial,
            current_A=self._interval("current", self.command.range_A),
            voltage_V=self._interval("voltage", (-math.inf, math.inf)),
            watchdog_s=(range_s.low, range_s.high) if range_s else None,
            lock_step=lock_step,
            has_sequence=self.sample.has_sequence,
            has_device_limits=all(self.map.by_role(role) for role in LIMIT_ROLES),
            has_ramp=self.map.by_role("ramp") is not None,
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


def _contiguous(registers: Sequence[Register], *, single: bool) -> list[tuple[tuple[Register, ...], str]]:
    """Split registers, in the given order, where one does not follow the one before it."""
    groups: list[list[Register]] = [[r] for r in registers[:1]]
    for left, right in pairwise(registers):
        if left.end == right.address and left.space == right.space and not single:
            groups[-1].append(right)
        else:
            groups.append([right])
    return [(tuple(g), ", ".join(f"'{r.name}'" for r in g)) for g in groups]


def _bits_of_role(device_map: DeviceMap, role: str) -> Mapping[str, int]:
    register = device_map.by_role(role)
    return device_map.bits.get(register.name, {}) if register else {}


def _named(bits: Mapping[str, int], raw: int) -> frozenset[str]:
    """Names of the bits that are set; set bits without a name are named by their number, never dropped."""
    known = dict(zip(bits.values(), bits, strict=True))
    return frozenset(known.get(i, f"bit_{i}") for i in range(raw.bit_length()) if raw >> i & 1)


def _whole(value: Value, otherwise: int) -> int:
    return value if isinstance(value, int) else otherwise
