"""What a command over CAN does to a simulated cycler."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from drivers.register_map import CanMap
from simulators.clocks import SimulatedClock
from simulators.cycler import Cycler, StateRefusedError, ValueRefusedError

__all__ = ["CanCommands", "CanRefusals"]

_CURRENTS = ("set_current", "limit_current_high", "limit_current_low")
_FIRST = ("clear_alarms", "remote", "output", "set_current", "heartbeat")  # in this order, whatever the map's is


@dataclass(frozen=True, slots=True, kw_only=True)
class CanRefusals:
    """Codes by which a device says no."""

    no_such_item: int = 1
    wrong_state: int = 2
    out_of_range: int = 3


class CanCommands:
    """Takes the arguments of commands.

    Attributes
    ----------
    voltage_limit_V : float
        The last one that was written; it is kept and not held.
    """

    def __init__(self, can_map: CanMap, cycler: Cycler, clock: SimulatedClock, refusals: CanRefusals) -> None:
        self._map, self._cycler, self._clock, self._refusals = can_map, cycler, clock, refusals
        self.voltage_limit_V = 0.0
        sends = [command.send for command in can_map.commands.values()]
        names = {name for send in sends for expression in send.values.values() for name in expression.names}
        # A device without a heartbeat of its own is kept awake by any command.
        self._beats = "heartbeat" in names or "heartbeat" in can_map.commands
        self._clears = "clear_alarms" in names
        self._turn = -1.0 if can_map.positive_current == "discharge" else 1.0
        if "remote" not in names:
            cycler.set_remote(True)  # a device that takes commands whenever they come

    def execute(self, command: str, arguments: Mapping[str, float]) -> int | None:
        """Take over a command as a whole; return the code of a refusal. Refused or not, it keeps the device awake."""
        code = self._execute(arguments)
        if command == "heartbeat" or not self._beats:
            self._cycler.heartbeat()
        return code

    def _execute(self, arguments: Mapping[str, float]) -> int | None:
        told = self._house(arguments)
        if not all(math.isfinite(value) for value in told.values()):
            return self._refusals.out_of_range
        if not self._clears:
            self._cycler.alarms.clear()  # some devices forget an error with the next valid frame
        try:
            self._check(told)
        except ValueRefusedError:
            return self._refusals.out_of_range
        except StateRefusedError:
            return self._refusals.wrong_state
        for name in _FIRST:
            if name in told:
                self._take(name, told[name])
        for name, value in told.items():
            if name not in _FIRST and name != "lock_step":
                self._take(name, value)
        if "lock_step" in told:
            self._clock.move_to(int(told["lock_step"]), self._cycler)
        return None

    def _house(self, arguments: Mapping[str, float]) -> dict[str, float]:
        """Arguments in the house's sign, with one set-point in place of one for each direction."""
        told = {name: value * self._turn if name in _CURRENTS else value for name, value in arguments.items()}
        told.pop("direction", None)  # follows from the two set-points
        if "charge" in told or "discharge" in told:
            now_A = self._cycler.requested_A
            sides = told.pop("charge", max(now_A, 0.0)), told.pop("discharge", max(-now_A, 0.0))
            told["set_current"] = sides[0] - sides[1]
        return told

    def _check(self, told: Mapping[str, float]) -> None:
        if "set_current" in told:
            self._cycler.check_set_point(told["set_current"])
        if "lock_step" in told:
            self._clock.check_tick(int(told["lock_step"]))
        if told.get("output"):
            alarms = bool(self._cycler.alarms) and not told.get("clear_alarms")
            self._cycler.check_output(remote=bool(told.get("remote", self._cycler.remote)), alarms=alarms)
        if told.get("ramp", 0.0) < 0.0 or told.get("watchdog", 1.0) <= 0.0 or told.get("lock_step_period", 1.0) <= 0.0:
            raise ValueRefusedError("a time or a ramp below zero")

    def _take(self, name: str, value: float) -> None:
        cycler = self._cycler
        if name == "clear_alarms" and value:
            cycler.alarms.clear()
        elif name == "remote":
            cycler.set_remote(bool(value))
        elif name == "output":
            cycler.set_output(bool(value))
        elif name == "set_current":
            cycler.set_current(value)
        elif name == "heartbeat":
            cycler.heartbeat()
        elif name == "voltage_limit":
            self.voltage_limit_V = value
        elif name == "watchdog":
            cycler.watchdog_s = value
            cycler.heartbeat()
        elif name == "lock_step_period":
            self._clock.set_period(value)
        elif name == "ramp":
            cycler.ramp_A_per_s = None if value in (0.0, self._map.unlimited_ramp) else value
        elif name == "hold_voltage":
            cycler.hold_V = None if value == self._map.no_hold else value
        elif name.startswith("limit_"):
            cycler.set_limit(name.removeprefix("limit_"), value)
