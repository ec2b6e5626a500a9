"""What a CAN device map says, as frozen values: data only, shared by drivers, simulators and tests.

The layout of the messages stands in the DBC file beside the map; the map says what they mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from drivers.device_map import LIMIT_ROLES
from drivers.expression import Expression

# What the bench can put into a message, by name, in the house's units and sign; true is 1. `charge` and `discharge`
# are the set-point's magnitude in each direction, zero in the other; `voltage_limit` is the bench's upper one while
# charging and its lower one while discharging; `direction` is 0 while charging or at rest, 1 while discharging.
ARGUMENTS = frozenset(
    ("set_current", "charge", "discharge", "output", "remote", "clear_alarms", "heartbeat", "lock_step",
     "lock_step_period", "watchdog", "ramp", "token", "voltage_limit", "direction", "hold_voltage", *LIMIT_ROLES)
)  # fmt: skip
CURRENT_ARGUMENTS = frozenset(("set_current", "limit_current_high", "limit_current_low"))
SAMPLE_ROLES = (
    "sequence", "actual_voltage", "actual_current", "temperature", "ambient_temperature", "setpoint_in_force",
)  # fmt: skip
ROLES = frozenset((*SAMPLE_ROLES, "serial", "firmware", "lock_step_available", "lock_step"))
CURRENT_ROLES = frozenset(("actual_current", "setpoint_in_force"))
SEQUENCES = ("acquire", "settings", "hold", "tick", "output", "safe", "release", "clear_fault")


@dataclass(frozen=True, slots=True)
class SignalName:
    """A signal of the DBC, written ``Message.Signal`` in the map."""

    message: str
    signal: str

    def __str__(self) -> str:
        """The way it stands in the map."""
        return f"{self.message}.{self.signal}"


@dataclass(frozen=True, slots=True)
class Flag:
    """A flag of the status: a bit of a signal's raw value, or set while that is one of `values` (none: not zero)."""

    name: SignalName
    values: frozenset[int] = frozenset()
    bit: int | None = None

    def is_set(self, raw: float) -> bool:
        """Whether a raw value means that the flag is set."""
        if self.bit is not None:
            return bool(int(raw) >> self.bit & 1)
        return raw in self.values if self.values else raw != 0


@dataclass(frozen=True, slots=True)
class Role:
    """Where a value of a sample stands: ``value = physical value of the DBC * scale``.

    `invalid` holds raw values that mean "missing"; `negative` is a flag that turns the sign of an unsigned value.
    """

    name: SignalName
    scale: Expression | None = None
    invalid: frozenset[float] = frozenset()
    negative: Flag | None = None


@dataclass(frozen=True, slots=True)
class Send:
    """A message that the bench sends: each signal's physical value as an expression of `ARGUMENTS` and constants.

    `length` cuts the message off after so many bytes.
    """

    message: str
    values: Mapping[str, Expression]
    length: int | None = None


@dataclass(frozen=True, slots=True)
class View:
    """One of several answers that come under one identifier: known by raw values, and perhaps shorter."""

    message: str
    where: Mapping[str, int]
    length: int | None = None


@dataclass(frozen=True, slots=True)
class Ask:
    """A message that makes the device answer with others; all of them belong to one answer."""

    name: str
    send: Send
    replies: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Command:
    """A message that tells the device something, and the message in which it repeats what it took.

    With `ask`, the echo comes only when asked for. `same` names the signals that must agree (empty: all that both
    messages have).
    """

    name: str
    send: Send
    echo: str | None = None
    ask: str | None = None
    same: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Step:
    """One command of a sequence, with the arguments that the sequence itself sets."""

    command: str
    arguments: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Refusal:
    """The message by which a device says no; `reasons` by raw code."""

    name: SignalName
    reasons: Mapping[int, str]


@dataclass(frozen=True, slots=True)
class CanFrame:
    """A sample frame: what stands on the bus, and the physical values that it means."""

    meaning: str
    message: str
    id: int
    data: bytes
    values: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class CanMap:
    """A whole map; validated by `drivers.register_map.load_can_map`.

    Attributes
    ----------
    dbc : Path
        The messages, with the identifiers of node 0.
    node_step : int
        Added to every identifier for each node number.
    min_gap_s, worst_reply_s : float
        Between two messages; silence after a time-out where answers carry no token.
    max_age_s : float
        Oldest cyclic message that a sample may be made of.
    execution_s : float
        So long after a command the device may still answer with what was before.
    unlimited_ramp, no_hold : float or None
        What to send for no ramp limit, and for no voltage to be held.
    identity : tuple
        A signal and the numbers that it may read; none: the number of the node.
    views : Mapping
        Answers that share an identifier, by the name that the rest of the map uses for a message.
    shared : tuple of str
        Messages that go both ways under one identifier.
    token : Mapping
        Message to the signal in which it repeats the token of the question.
    """

    file: Path
    name: str
    title: str
    source: str
    verified_on_hardware: bool
    dbc: Path
    fd: bool
    node_step: int
    min_gap_s: float
    worst_reply_s: float
    max_age_s: float
    positive_current: Literal["charge", "discharge"]
    identity: tuple[SignalName, tuple[float, ...]]
    constants: Mapping[str, SignalName]
    capabilities: Mapping[str, tuple[Expression, Expression]]
    asks: Mapping[str, Ask]
    commands: Mapping[str, Command]
    roles: Mapping[str, Role]
    status: Mapping[str, Flag]
    alarms: Mapping[str, Flag]
    sequences: Mapping[str, tuple[Step, ...]]
    execution_s: float = 0.0
    unlimited_ramp: float | None = None
    no_hold: float | None = None
    refusal: Refusal | None = None
    token: Mapping[str, str] = field(default_factory=dict)
    shared: tuple[str, ...] = ()
    views: Mapping[str, View] = field(default_factory=dict)
    frames: tuple[CanFrame, ...] = ()

    @property
    def sampled(self) -> tuple[str, ...]:
        """Messages that a sample is made of, sorted."""
        flags = [*self.status.values(), *self.alarms.values()]
        flags += [role.negative for role in self.roles.values() if role.negative]
        names = {self.roles[role].name.message for role in SAMPLE_ROLES if role in self.roles}
        return tuple(sorted(names | {flag.name.message for flag in flags}))

    def base(self, message: str) -> str:
        """Return the DBC's message behind a name."""
        view = self.views.get(message)
        return message if view is None else view.message

    def ask_for(self, message: str) -> Ask | None:
        """Return the question that a message answers; None where it comes by itself."""
        return next((ask for ask in self.asks.values() if message in ask.replies), None)

    def signals(self) -> list[tuple[str, SignalName]]:
        """Every signal that the map reads, with the key that names it."""
        found = [("identity.signal", self.identity[0])]
        found += [(f"const.{name}", signal) for name, signal in self.constants.items()]
        for key, role in self.roles.items():
            found.append((f"role.{key}", role.name))
            if role.negative:
                found.append((f"role.{key}.negative", role.negative.name))
        for table, flags in (("status", self.status), ("alarms", self.alarms)):
            found += [(f"{table}.{name}", flag.name) for name, flag in flags.items()]
        if self.refusal:
            found.append(("refusal.code", self.refusal.name))
        found += [(f"token.{message}", SignalName(message, signal)) for message, signal in self.token.items()]
        return found
