"""A CAN map with the constants of one device put in: what is sent and how a sample is read. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from drivers.can_codec import CanCodec
from drivers.can_map import CURRENT_ARGUMENTS, CURRENT_ROLES, CanMap, Command, Flag, Role, Send
from drivers.codec import check_watchdog
from drivers.cycler import Capabilities, DeviceLimits, Reading
from drivers.device_map import LIMIT_ROLES
from drivers.errors import CyclerProtocolError, SetPointRefusedError
from drivers.expression import Expression, ExpressionError
from drivers.setpoint_watch import unrolled

Raws = Mapping[str, dict[str, float]]  # raw signal values by message


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A frame ready to go, and the message that must repeat it."""

    command: Command
    message: str
    data: bytes
    arguments: frozenset[str]


class CanPlan:
    """Everything about one connected device that does not change while it is connected.

    Raises
    ------
    CyclerProtocolError
        If the constants make a scale or a range unusable.
    """

    def __init__(self, can_map: CanMap, codec: CanCodec, constants: Mapping[str, float]) -> None:
        self.map, self.codec, self.constants = can_map, codec, constants
        self.turn = -1.0 if can_map.positive_current == "discharge" else 1.0
        self.current_A = self._interval("current", (-math.inf, math.inf))
        self._scales = {key: self._scale(key, role) for key, role in can_map.roles.items()}
        bits = self._role_bits("sequence")
        self._counter = 1 << bits if bits else 0
        self.heartbeat_modulus = 1 << min((self._argument_bits("heartbeat") or 1), 16)
        self.token_modulus = 1 << min((self._argument_bits("token") or 1), 16)

    def _scale(self, key: str, role: Role) -> float:
        try:
            scale = role.scale.evaluate(self.constants) if role.scale else 1.0
        except ExpressionError as error:
            raise CyclerProtocolError(f"map '{self.map.name}', role.{key}: {error}") from None
        return scale * (self.turn if key in CURRENT_ROLES else 1.0)

    def _role_bits(self, key: str) -> int:
        role = self.map.roles.get(key)
        return self.codec.bits(role.name.message, role.name.signal) if role else 0

    def _argument_bits(self, argument: str) -> int:
        sends = [c.send for c in self.map.commands.values()] + [a.send for a in self.map.asks.values()]
        found = [
            self.codec.bits(send.message, signal)
            for send in sends
            for signal, expression in send.values.items()
            if expression.names == {argument}
        ]
        return min(found, default=0)

    # --- out -----------------------------------------------------------------------------------------------
    def frame(self, send: Send, arguments: Mapping[str, float]) -> bytes:
        """Encode a message from the arguments, in the house's units and sign.

        Raises
        ------
        SetPointRefusedError
            If a value is not finite, or does not fit.
        """
        known = dict(self.constants) | {
            name: value * self.turn if name in CURRENT_ARGUMENTS else value for name, value in arguments.items()
        }
        values: dict[str, float] = {}
        for signal, expression in send.values.items():
            try:
                values[signal] = expression.evaluate(known)
            except ExpressionError as error:
                raise SetPointRefusedError(f"message '{send.message}', {signal}: {error}; not sent") from None
        data = self.codec.encode(send.message, values)
        if "watchdog" in arguments:
            self._check_watchdog(send, values, data)
        return data if send.length is None else data[: send.length]

    def _check_watchdog(self, send: Send, values: Mapping[str, float], data: bytes) -> None:
        """Refuse a watchdog that is none, or a longer one, once it is rounded to the signal's steps."""
        for signal, expression in send.values.items():
            if "watchdog" in expression.names:
                raws = self.codec.raw(send.message, data)
                written = self.codec.physical(send.message, {signal: raws[signal]})[signal]
                step = self.codec.resolution(send.message, signal)
                check_watchdog(f"message '{send.message}', {signal}", values[signal], written, step, unit="")

    def outgoing(self, sequence: str, arguments: Mapping[str, float]) -> list[Outgoing]:
        """Frames of a sequence, in order; `settings` that have no value here are left out."""
        result = []
        for step in self.map.sequences[sequence]:
            command = self.map.commands[step.command]
            needed = frozenset(name for e in command.send.values.values() for name in e.names) - set(self.constants)
            have = with_directions({**arguments, **step.arguments})
            if sequence == "settings" and not needed <= set(have):
                continue
            data = self.frame(command.send, have)
            result.append(Outgoing(command, command.send.message, data, needed))
        return result

    def hold(self, voltage_V: float | None) -> dict[str, float]:
        """Argument that has the device hold a voltage, or none any more; empty where it has nothing to be told.

        Raises
        ------
        SetPointRefusedError
            It can hold none, or none as high or as low.
        """
        none_V = self.map.no_hold
        if not self.map.sequences["hold"] or none_V is None:
            if voltage_V is not None:
                raise SetPointRefusedError(f"map '{self.map.name}' has no voltage to hold; {voltage_V:g} V not sent")
            return {}
        low_V, high_V = self._interval("voltage", (-math.inf, math.inf))
        if voltage_V is not None and not low_V <= voltage_V <= high_V:  # also true for NaN
            raise SetPointRefusedError(f"{voltage_V:g} V to hold is outside {low_V:g} .. {high_V:g} V; not sent")
        return {"hold_voltage": none_V if voltage_V is None else voltage_V}

    def check_current(self, current_A: float) -> None:
        """Refuse a set-point that the device cannot have.

        Raises
        ------
        SetPointRefusedError
        """
        low_A, high_A = self.current_A
        if not low_A <= current_A <= high_A:  # also false for NaN
            raise SetPointRefusedError(f"set-point {current_A:g} A is outside {low_A:g} .. {high_A:g} A; not sent")

    def echoes(self, sent: Outgoing, echo: bytes) -> str | None:
        """Return None if an echo repeats a command, else which signal differs."""
        name = sent.command.echo or ""
        whole = sent.data.ljust(len(self.codec.encode(sent.message, {})), b"\0")
        told, found = self.codec.raw(sent.message, whole), self.codec.raw(name, echo)
        for signal in sent.command.same or tuple(signal for signal in told if signal in found):
            if told[signal] != found[signal]:
                factor = self.codec.physical(sent.message, {signal: told[signal]})[signal]
                other = self.codec.physical(name, {signal: found[signal]})[signal]
                return f"{signal} was sent as {factor:g}, the device repeats {other:g}"
        return None

    def tolerance_A(self) -> float:
        """How far the set-point in force may be off by rounding; infinite where the device does not tell it."""
        role = self.map.roles.get("setpoint_in_force")
        if role is None:
            return math.inf
        sent = [
            self.codec.resolution(command.send.message, signal) / self._slope(expression)
            for step in self.map.sequences["tick"]
            for command in [self.map.commands[step.command]]
            for signal, expression in command.send.values.items()
            if expression.names & {"set_current", "charge", "discharge"}
        ]
        told = self.codec.resolution(role.name.message, role.name.signal) * abs(self._scales["setpoint_in_force"])
        return 0.51 * (max(sent, default=0.0) + told)

    def _slope(self, expression: Expression) -> float:
        at = {name: 0.0 for name in ("set_current", "charge", "discharge", "output", "heartbeat", "lock_step")}
        at |= {"direction": 0.0, "voltage_limit": 0.0}
        moved = at | {"set_current": 1.0, "charge": 1.0, "discharge": 1.0}
        low, high = expression.evaluate({**self.constants, **at}), expression.evaluate({**self.constants, **moved})
        return abs(high - low) or 1.0

    # --- in ------------------------------------------------------------------------------------------------
    def reading(self, monotonic_s: float, last: int, messages: Mapping[str, bytes]) -> Reading:
        """Make a reading of the newest frames; `last` is the sequence number of the reading before."""
        raws = {name: self.codec.raw(name, messages[name]) for name in self.map.sampled}
        status = frozenset(name for name, flag in self.map.status.items() if _is_set(flag, raws))
        return Reading(
            monotonic_s=monotonic_s,
            sequence=self._sequence(raws, last),
            voltage_V=self._value("actual_voltage", raws),
            current_A=self._value("actual_current", raws),
            temperature_degC=self._value("temperature", raws),
            ambient_degC=self._value("ambient_temperature", raws),
            setpoint_in_force_A=self._value("setpoint_in_force", raws),
            output_on="output_on" in status,
            status=status,
            alarms=frozenset(name for name, flag in self.map.alarms.items() if _is_set(flag, raws)),
        )

    def role_value(self, key: str, raws: Raws) -> float:
        """Value of a role; NaN where the device says "missing", or the map has no such role."""
        return self._value(key, raws)

    def _value(self, key: str, raws: Raws) -> float:
        role = self.map.roles.get(key)
        if role is None:
            return math.nan
        raw = raws[role.name.message][role.name.signal]
        if raw in role.invalid or not math.isfinite(raw):
            return math.nan
        value = self.codec.physical(role.name.message, {role.name.signal: raw})[role.name.signal] * self._scales[key]
        return -value if role.negative is not None and _is_set(role.negative, raws) else value + 0.0  # never -0.0

    def _sequence(self, raws: Raws, last: int) -> int:
        role = self.map.roles.get("sequence")
        return unrolled(None if role is None else int(raws[role.name.message][role.name.signal]), last, self._counter)

    def capabilities(self, identity: Mapping[str, str], *, lock_step: bool) -> Capabilities:
        """What the device can do, by its map and its constants."""
        told = {
            name
            for step in self.map.sequences["settings"]
            for expression in self.map.commands[step.command].send.values.values()
            for name in expression.names
        }
        return Capabilities(
            name=self.map.title,
            **identity,
            current_A=self.current_A,
            voltage_V=self._interval("voltage", (-math.inf, math.inf)),
            watchdog_s=self._interval("watchdog", (0.0, math.inf)) if "watchdog" in self.map.capabilities else None,
            lock_step=lock_step,
            has_sequence="sequence" in self.map.roles,
            has_device_limits=set(LIMIT_ROLES) <= told,
            has_ramp="ramp" in told,
            has_hold=bool(self.map.sequences["hold"]),
            has_temperature="temperature" in self.map.roles,
        )

    def _interval(self, name: str, otherwise: tuple[float, float]) -> tuple[float, float]:
        pair = self.map.capabilities.get(name)
        if pair is None:
            return otherwise
        try:
            return pair[0].evaluate(self.constants), pair[1].evaluate(self.constants)
        except ExpressionError as error:
            raise CyclerProtocolError(f"map '{self.map.name}', capabilities.{name}: {error}") from None


def with_directions(arguments: Mapping[str, float]) -> dict[str, float]:
    """Add the set-point's magnitude in each direction, for devices that have a register for either."""
    current_A = arguments.get("set_current")
    if current_A is None:
        return dict(arguments)
    sides = {"charge": max(current_A, 0.0), "discharge": max(-current_A, 0.0), "direction": float(current_A < 0.0)}
    return {**arguments, **sides}


def limit_arguments(can_map: CanMap, limits: DeviceLimits) -> dict[str, float]:
    """Limits by argument name."""
    sides = {"voltage": limits.voltage_V, "current": limits.current_A, "temperature": limits.temperature_degC}
    values = {}
    for role in LIMIT_ROLES:
        _, quantity, side = role.split("_")
        # With the other current convention the device's upper limit is the house's lower one, turned.
        high = (side == "high") != (quantity == "current" and can_map.positive_current == "discharge")
        values[role] = sides[quantity][high]
    ramp = can_map.unlimited_ramp if limits.ramp_A_per_s is None else limits.ramp_A_per_s
    return values | ({} if ramp is None else {"ramp": ramp})


def _is_set(flag: Flag, raws: Raws) -> bool:
    return flag.is_set(raws[flag.name.message][flag.name.signal])
