"""What writing a register or a coil does to a simulated cycler, by its role; values in the house's sign."""

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

from drivers.register_map import DeviceMap
from simulators.clocks import SimulatedClock
from simulators.cycler import Cycler, StateRefusedError, ValueRefusedError
from simulators.modbus_refusals import ILLEGAL_VALUE, ModbusRefusals, RefusedError

__all__ = ["RegisterCommands"]


class RegisterCommands:
    """Takes values by role.

    Attributes
    ----------
    heartbeat : float
        The last one that was written.
    set_voltage_V : float
        The voltage set-point of a device with a current set-point for each direction; it is kept and not held.
    unlimited_ramp, no_hold_V : float
        What the registers hold where there is no ramp, and no voltage to hold.
    """

    def __init__(self, device_map: DeviceMap, cycler: Cycler, clock: SimulatedClock, refusals: ModbusRefusals) -> None:
        self._cycler, self._clock, self._refusals = cycler, clock, refusals
        self.heartbeat = self.set_voltage_V = 0.0
        ramp = device_map.by_role("ramp")
        self.unlimited_ramp = ramp.unlimited or 0.0 if ramp else 0.0
        hold = device_map.by_role("hold_voltage")
        self.no_hold_V = hold.unlimited or 0.0 if hold else 0.0
        self._directions = {"set_charge": 0.0, "set_discharge": 0.0}
        self._setters = self._bound()

    def has(self, role: str | None) -> bool:
        """Whether a role does anything; other registers are plain memory."""
        return role in self._setters

    def check(self, role: str | None, value: float) -> None:
        """Say whether a value would be taken, as far as this device tells.

        Raises
        ------
        RefusedError
            If it is out of range, or the device's state does not allow it.
        """
        try:
            if role in ("set_current", "set_charge", "set_discharge"):
                self._cycler.check_set_point(-value if role == "set_discharge" else value)
            elif role == "output" and value:
                self._cycler.check_output(remote=self._cycler.remote, alarms=bool(self._cycler.alarms))
            elif role == "lock_step":
                self._clock.check_tick(int(value))
            elif role == "ramp" and value < 0.0:
                raise ValueRefusedError(f"ramp {value} A/s; it must be above 0, or 0 for none")
        except ValueRefusedError as error:
            if self._refusals.tells_out_of_range:
                raise RefusedError(ILLEGAL_VALUE, str(error)) from error
        except StateRefusedError as error:
            raise RefusedError(self._refusals.wrong_state, str(error)) from error

    def is_taken(self, role: str | None, value: float) -> bool:
        """Whether a checked value is taken: a device that tells of no refusal passes over what is out of range."""
        if self._refusals.tells_out_of_range or role not in ("set_charge", "set_discharge"):
            return True
        limits = self._cycler.limits
        return value <= (limits["current_high"] if role == "set_charge" else -limits["current_low"])

    def take(self, role: str, value: float) -> None:
        """Do what a checked value says."""
        self._setters[role](value)

    def switch(self, roles: Mapping[str, bool]) -> None:
        """Clear alarms, take or give back remote control, switch the output: all that one message says, or nothing.

        Raises
        ------
        RefusedError
            If the output may not be switched on.
        """
        cycler = self._cycler
        alarms = bool(cycler.alarms) and not roles.get("clear_alarms", False)
        if roles.get("output", False):
            try:
                cycler.check_output(remote=roles.get("remote", cycler.remote), alarms=alarms)
            except StateRefusedError as error:
                raise RefusedError(self._refusals.wrong_state, str(error)) from error
        if not alarms:
            cycler.alarms.clear()
        if "remote" in roles:
            cycler.set_remote(roles["remote"])
        if "output" in roles:
            cycler.set_output(roles["output"])

    def _bound(self) -> Mapping[str, Callable[[float], None]]:
        cycler, clock = self._cycler, self._clock
        setters: dict[str, Callable[[float], None]] = {
            "set_current": cycler.set_current,
            "set_charge": partial(self._set_direction, "set_charge"),
            "set_discharge": partial(self._set_direction, "set_discharge"),
            "set_voltage": self._set_voltage,
            "remote": lambda on: self.switch({"remote": bool(on)}),
            "output": lambda on: self.switch({"output": bool(on)}),
            "clear_alarms": lambda on: self.switch({"clear_alarms": bool(on)}),
            "heartbeat": self._beat,
            "lock_step": lambda tick: clock.move_to(int(tick), cycler),
            "lock_step_period": clock.set_period,
            "watchdog": self._set_watchdog,
            "ramp": self._set_ramp,
            "hold_voltage": self._set_hold,
        }
        setters |= {f"limit_{name}": partial(cycler.set_limit, name) for name in cycler.limits}
        return MappingProxyType(setters)

    def _set_direction(self, role: str, value: float) -> None:
        self._directions[role] = value
        self._cycler.set_current(self._directions["set_charge"] - self._directions["set_discharge"])

    def _set_voltage(self, voltage_V: float) -> None:
        self.set_voltage_V = voltage_V

    def _beat(self, value: float) -> None:
        self.heartbeat = value
        self._cycler.heartbeat()

    def _set_watchdog(self, time_s: float) -> None:
        self._cycler.watchdog_s = time_s
        self._cycler.heartbeat()

    def _set_ramp(self, ramp_A_per_s: float) -> None:
        none = ramp_A_per_s in (0.0, self.unlimited_ramp)
        self._cycler.ramp_A_per_s = None if none else ramp_A_per_s

    def _set_hold(self, voltage_V: float) -> None:
        self._cycler.hold_V = None if voltage_V == self.no_hold_V else voltage_V
