"""What goes out to a Modbus device with each tick: set-point, heartbeat and lock-step tick, as messages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

from drivers.codec import Codec
from drivers.device_map import COMMAND_ROLES, SETPOINT_ROLES, DeviceMap, Register
from drivers.errors import SetPointRefusedError


@dataclass(frozen=True, slots=True)
class Write:
    """Consecutive registers that go out in one message."""

    first: int
    values: tuple[int, ...]
    label: str


def differs(write: Write, found: tuple[int, ...]) -> str:
    """Say that registers read otherwise than they were written."""
    wrote, reads = (" ".join(f"{value:04X}" for value in values) for values in (write.values, found))
    return f"{write.label} read back differently: wrote {wrote}, reads {reads} (registers from {write.first})"


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
        self._timed = contiguous(found, single=device_map.single_writes)
        self._untimed = contiguous([r for r in found if r.role != "lock_step"], single=device_map.single_writes)
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


def contiguous(registers: Sequence[Register], *, single: bool) -> list[tuple[tuple[Register, ...], str]]:
    """Split registers, in the given order, where one does not follow the one before it."""
    groups: list[list[Register]] = [[r] for r in registers[:1]]
    for left, right in pairwise(registers):
        if left.end == right.address and left.space == right.space and not single:
            groups[-1].append(right)
        else:
            groups.append([right])
    return [(tuple(g), ", ".join(f"'{r.name}'" for r in g)) for g in groups]
