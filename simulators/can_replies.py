"""The messages that a simulated CAN device tells of itself, as they stand now."""

import math
from collections.abc import Mapping

from drivers.register_map import CanMap, Flag
from simulators.can_commands import CanCommands
from simulators.can_dbc import Layout
from simulators.clocks import SimulatedClock
from simulators.cycler import Cycler

__all__ = ["CanReplies"]

# Alarms of the simulated cycler under the names that some devices have for them.
_OTHER_NAMES = {
    "low_side_voltage": frozenset(("over_voltage", "under_voltage")),
    "low_side_current": frozenset(("over_current",)),
    "communication": frozenset(("watchdog", "client_gone")),
    "over_current": frozenset(("over_current",)),
    "temperature": frozenset(("over_temperature", "under_temperature")),
    "alarm": frozenset(
        ("over_voltage", "under_voltage", "over_current", "over_temperature", "under_temperature", "watchdog",
         "client_gone", "internal")
    ),
}  # fmt: skip


class CanReplies:
    """Makes messages of a cycler, its clock, and what it was told.

    Parameters
    ----------
    can_map : CanMap
    layouts : mapping of str to Layout
    cycler : Cycler
    clock : SimulatedClock
    commands : CanCommands
    constants : mapping of str to float
        Of the map's expressions.
    """

    def __init__(
        self,
        can_map: CanMap,
        layouts: Mapping[str, Layout],
        cycler: Cycler,
        clock: SimulatedClock,
        commands: CanCommands,
        constants: Mapping[str, float],
    ) -> None:
        self._map, self._layouts, self._constants = can_map, layouts, constants
        self._cycler, self._clock, self._commands = cycler, clock, commands
        self._turn = -1.0 if can_map.positive_current == "discharge" else 1.0

    def message(self, name: str, node: int, token: float = 0.0) -> bytes:
        """Return the data of a message; `token` is that of the question, where there was one."""
        layout, raws = self._layouts[name], self._held(name)
        if (where := self._map.token.get(name)) is not None:
            raws[where] = token
        identity, equals = self._map.identity
        if identity.message == name:
            raws[identity.signal] = self._raw(name, identity.signal, equals[0] if equals else node)
        for constant, signal in self._map.constants.items():
            if signal.message == name:
                raws[signal.signal] = self._raw(name, signal.signal, self._constants[constant])
        self._put_roles(name, raws)
        self._put_flags(name, raws)
        return layout.encode_raw(raws)

    def refusal(self, code: int) -> tuple[str, bytes] | None:
        """Return the message by which the device says no; None where it cannot."""
        refusal = self._map.refusal
        if refusal is None:
            return None
        name = refusal.name
        view = self._map.views.get(name.message)
        fixed: Mapping[str, float] = {} if view is None else view.where
        return name.message, self._layouts[name.message].encode_raw({**fixed, name.signal: code})

    def repeated(self, echo: str, raws: Mapping[str, float]) -> bytes:
        """Return the message that repeats what was sent."""
        layout = self._layouts[echo]
        return layout.encode_raw({name: raw for name, raw in raws.items() if name in layout.signals})

    # --- parts of a message --------------------------------------------------------------------------------
    def _put_roles(self, name: str, raws: dict[str, float]) -> None:
        for key, role in self._map.roles.items():
            if role.name.message == name:
                raws[role.name.signal] = self._role_raw(key)
            if role.negative is not None and role.negative.name.message == name and self._role_value(key) < 0.0:
                _raise_flag(raws, role.negative)

    def _put_flags(self, name: str, raws: dict[str, float]) -> None:
        for flags, names in ((self._map.status, self._status()), (self._map.alarms, self._cycler.alarms)):
            for flag, where in flags.items():
                if where.name.message == name and (flag in names or _OTHER_NAMES.get(flag, frozenset()) & names):
                    _raise_flag(raws, where)

    def _held(self, name: str) -> dict[str, float]:
        """What a message tells of the last command where that is asked for: what was taken, not what was sent."""
        view, known = self._map.views.get(name), {**self._constants, **self._taken()}
        raws = {} if view is None else {signal: float(value) for signal, value in view.where.items()}
        for command in self._map.commands.values():
            if not (name in self._map.shared and command.send.message == name) and command.echo != name:
                continue
            for signal, expression in command.send.values.items():
                if expression.names and expression.names <= known.keys():
                    raws[signal] = self._raw(name, signal, expression.evaluate(known))
        return raws

    def _taken(self) -> dict[str, float]:
        """Arguments of commands as they are in force, current in the device's own sign."""
        cycler = self._cycler
        state = {
            "set_current": cycler.requested_A * self._turn,
            "output": float(cycler.output_on),
            "remote": float(cycler.remote),
            "watchdog": cycler.watchdog_s,
            "voltage_limit": self._commands.voltage_limit_V,
            "charge": max(cycler.requested_A, 0.0),
            "discharge": max(-cycler.requested_A, 0.0),
            "direction": float(cycler.requested_A < 0.0),
        }
        return state | {
            f"limit_{key}": value * (self._turn if "current" in key else 1.0) for key, value in cycler.limits.items()
        }

    def _status(self) -> frozenset[str]:
        status = self._cycler.status
        return status | {"lock_step"} if self._clock.lock_step else status

    def _raw(self, message: str, signal: str, value: float) -> float:
        found = self._layouts[message].signals[signal]
        return value if found.floating else (value - found.offset) / found.factor

    def _role_raw(self, key: str) -> float:
        role, value = self._map.roles[key], self._role_value(key)
        if math.isnan(value) and role.invalid:
            return min(role.invalid)
        scale = role.scale.evaluate(self._constants) if role.scale else 1.0
        if key in ("actual_current", "setpoint_in_force"):
            value *= self._turn
        if role.negative is not None:
            value = abs(value)
        return self._raw(role.name.message, role.name.signal, value / scale)

    def _role_value(self, key: str) -> float:
        cycler = self._cycler
        seen = cycler.measurement
        return {
            "sequence": float(cycler.sequence),
            "actual_voltage": seen.voltage_V,
            "actual_current": seen.current_A,
            "temperature": seen.temperature_degC,
            "ambient_temperature": seen.ambient_degC,
            "setpoint_in_force": cycler.set_point_A,
            "serial": float(cycler.settings.serial),
            "firmware": float(cycler.settings.firmware),
            "lock_step_available": float(self._clock.lock_step),
            "lock_step": float(self._clock.tick),
        }[key]


def _raise_flag(raws: dict[str, float], flag: Flag) -> None:
    """Put a flag into the raw values of its message."""
    signal = flag.name.signal
    raws[signal] = min(flag.values, default=1) if flag.bit is None else int(raws.get(signal, 0.0)) | 1 << flag.bit
