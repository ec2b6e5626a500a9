"""What a device map says, as frozen values: data only, shared by drivers, simulators and tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from drivers.expression import Expression

Space = Literal["holding", "input"]
Transport = Literal["modbus"]
Kind = Literal["cycler", "chamber"]
WordOrder = Literal["big", "little"]

# Registers that one value of a type takes; a string says its own length.
TYPE_WORDS: Mapping[str, int] = {"u16": 1, "i16": 1, "u32": 2, "i32": 2, "f32": 2, "f64": 4}

LIMIT_ROLES = tuple(
    f"limit_{quantity}_{side}" for quantity in ("voltage", "current", "temperature") for side in ("high", "low")
)
# A device has one signed set-point, or one for each direction, perhaps with a voltage that it must not pass.
SETPOINT_ROLES = ("set_current", "set_charge", "set_discharge", "set_voltage")
COMMAND_ROLES = ("set_current", "heartbeat", "lock_step")
SWITCH_ROLES = ("remote", "output", "clear_alarms")  # a coil, or a register that takes 1 and 0
SAMPLE_ROLES = (
    "sequence", "actual_voltage", "actual_current", "temperature", "ambient_temperature",
    "setpoint_in_force", "status", "alarms",
)  # fmt: skip
IDENTITY_ROLES = ("maker", "model", "serial", "firmware")
REGISTER_ROLES = frozenset(
    (*SETPOINT_ROLES, *COMMAND_ROLES, *SAMPLE_ROLES, *LIMIT_ROLES, *SWITCH_ROLES, "ramp", "watchdog", "hold_voltage",
     "set_temperature", "lock_step_available", "lock_step_period", *IDENTITY_ROLES)
)  # fmt: skip
COIL_ROLES = frozenset(SWITCH_ROLES)
# Registers whose sign `positive_current` turns. Roles speak the house's language: limit_current_high is the limit
# of charging, in whichever register a device of the other convention keeps it.
CURRENT_ROLES = frozenset(
    ("set_current", "actual_current", "setpoint_in_force", "limit_current_high", "limit_current_low")
)


@dataclass(frozen=True, slots=True)
class Verify:
    """How a write is known to have worked.

    `kind` is "none", "echo" (the reply repeats the value) or "readback"; `register` names the register that is
    read back where that is another one.
    """

    kind: Literal["none", "echo", "readback"] = "none"
    register: str | None = None


@dataclass(frozen=True, slots=True)
class Register:
    """One value in the register space: ``value = raw * scale``, in `unit`.

    `range` is in engineering units and the house's sign; `invalid` holds raw bit patterns that mean "missing";
    `raw_max` is the largest raw number that the device takes; `negative` is the status bit that turns an unsigned
    value's sign.
    """

    name: str
    address: int
    type: str
    words: int
    space: Space
    access: Literal["r", "w", "rw"]
    word_order: WordOrder
    unit: str = ""
    role: str | None = None
    scale: Expression | None = None
    range: tuple[Expression, Expression] | None = None
    raw_max: int | None = None
    invalid: tuple[int, ...] = ()
    unlimited: float | None = None
    verify: Verify = Verify()
    negative: str | None = None

    @property
    def end(self) -> int:
        """First address after the register."""
        return self.address + self.words

    @property
    def readable(self) -> bool:
        """Whether the map allows it to be read."""
        return "r" in self.access

    @property
    def writable(self) -> bool:
        """Whether the map allows it to be written."""
        return "w" in self.access


@dataclass(frozen=True, slots=True)
class Coil:
    """One bit that is written, and perhaps read, on its own."""

    name: str
    address: int
    access: Literal["r", "w", "rw"]
    role: str | None = None


@dataclass(frozen=True, slots=True)
class Block:
    """A range of addresses, `first` to `last` inclusive, of which any part may be read in one message.

    With `one_type`, a message may hold registers of one type only.
    """

    space: Space
    first: int
    last: int
    one_type: bool = False


@dataclass(frozen=True, slots=True)
class Identity:
    """The register that tells this family of devices from others, and what it may read."""

    register: str
    equals: tuple[float | str, ...]


@dataclass(frozen=True, slots=True)
class Step:
    """One write of a sequence: a fixed value, or the caller's value named by `argument`."""

    write: str
    value: float | bool | None
    argument: str | None = None


@dataclass(frozen=True, slots=True)
class Frame:
    """A sample frame, without MBAP header or CRC: what is asked, what is answered, and what it means."""

    meaning: str
    request: bytes
    reply: bytes
    values: Mapping[str, float | bool | str]
    missing: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class DeviceMap:
    """A whole map; validated by `drivers.register_map.load_map`.

    `kind`: what it is the map of; of a chamber `temperature` is that of its air. `single_writes`: one register per
    message. `alarm_bits` are bits of the status that count as alarms.
    `worst_reply_s` is the longest that the device may take for an answer on a serial line.
    """

    file: Path
    name: str
    title: str
    source: str
    kind: Kind
    verified_on_hardware: bool
    transport: Transport
    unit_id: int
    word_order: WordOrder
    functions: frozenset[int]
    min_gap_s: float
    worst_reply_s: float
    max_read_registers: int
    single_writes: bool
    positive_current: Literal["charge", "discharge"]
    identity: Identity
    constants: Mapping[str, str]
    capabilities: Mapping[str, tuple[Expression, Expression]]
    blocks: tuple[Block, ...]
    registers: Mapping[str, Register]
    coils: Mapping[str, Coil]
    bits: Mapping[str, Mapping[str, int]]
    alarm_bits: tuple[str, ...]
    sequences: Mapping[str, tuple[Step, ...]]
    frames: tuple[Frame, ...]

    def by_role(self, role: str) -> Register | None:
        """Return the register that has a role, or None; where nothing is the status, the output's own register is."""
        found = next((r for r in self.registers.values() if r.role == role), None)
        return self.by_role("output") if found is None and role == "status" else found

    @property
    def has_directions(self) -> bool:
        """Whether there is a set-point for each direction of the current instead of a signed one."""
        return self.by_role("set_current") is None

    def switch(self, role: str) -> Coil | Register | None:
        """Return what switches remote mode, the output, or clears alarms: a coil or a register, or None."""
        return self.coil_by_role(role) or self.by_role(role)

    def coil_by_role(self, role: str) -> Coil | None:
        """Return the coil that has a role, or None."""
        return next((c for c in self.coils.values() if c.role == role), None)
