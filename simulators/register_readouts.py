"""What registers show of a simulated cycler, by their role; values in the house's sign."""

from collections.abc import Callable, Mapping
from functools import partial

from drivers.register_map import DeviceMap
from simulators.clocks import SimulatedClock
from simulators.cycler import Cycler
from simulators.register_commands import RegisterCommands

__all__ = ["RegisterReadouts"]

Readouts = dict[str, Callable[[], float]]


class RegisterReadouts:
    """Reads a cycler, its clock, and what it was told."""

    def __init__(
        self, device_map: DeviceMap, cycler: Cycler, clock: SimulatedClock, commands: RegisterCommands
    ) -> None:
        self._map, self._cycler, self._clock, self._commands = device_map, cycler, clock, commands
        self._bits = {role: self._bits_of(role) for role in ("status", "alarms")}
        current = device_map.by_role("actual_current")
        self._sink = current.negative if current else None  # flag that stands for the sign of an unsigned current

    def by_role(self) -> Readouts:
        """Return what each role shows."""
        return self._measured() | self._told() | self._flags() | self._timing()

    def _measured(self) -> Readouts:
        cycler = self._cycler
        return {
            "sequence": lambda: cycler.sequence,
            "actual_voltage": lambda: cycler.measurement.voltage_V,
            "actual_current": self._actual_current,
            "temperature": lambda: cycler.measurement.temperature_degC,
            "ambient_temperature": lambda: cycler.measurement.ambient_degC,
            "setpoint_in_force": lambda: cycler.set_point_A,
            "serial": lambda: cycler.settings.serial,
            "firmware": lambda: cycler.settings.firmware,
        }

    def _told(self) -> Readouts:
        cycler, commands = self._cycler, self._commands
        told: Readouts = {
            "set_current": lambda: cycler.requested_A,
            "set_charge": lambda: max(cycler.requested_A, 0.0),
            "set_discharge": lambda: max(-cycler.requested_A, 0.0),
            "set_voltage": lambda: commands.set_voltage_V,
            "ramp": self._ramp,
            "hold_voltage": lambda: commands.no_hold_V if cycler.hold_V is None else cycler.hold_V,
        }
        return told | {f"limit_{name}": partial(cycler.limits.__getitem__, name) for name in cycler.limits}

    def _flags(self) -> Readouts:
        cycler = self._cycler
        shared = self._map.by_role("status") is self._map.by_role("output")
        return {
            "remote": lambda: float(cycler.remote),
            "output": lambda: float(_bit_sum(self._bits["status"], self._status()) if shared else cycler.output_on),
            "clear_alarms": lambda: 0.0,
            "status": lambda: _bit_sum(self._bits["status"], self._status()),
            "alarms": lambda: _bit_sum(self._bits["alarms"], cycler.alarms),
        }

    def _timing(self) -> Readouts:
        cycler, clock, commands = self._cycler, self._clock, self._commands
        return {
            "heartbeat": lambda: commands.heartbeat,
            "watchdog": lambda: cycler.watchdog_s,
            "lock_step": lambda: clock.tick,
            "lock_step_available": lambda: float(clock.lock_step),
            "lock_step_period": lambda: clock.period_s,
        }

    def _bits_of(self, role: str) -> Mapping[str, int]:
        register = self._map.by_role(role)
        return self._map.bits.get(register.name, {}) if register else {}

    def _actual_current(self) -> float:
        seen_A = self._cycler.measurement.current_A
        return abs(seen_A) if self._sink else seen_A

    def _status(self) -> frozenset[str]:
        status = self._cycler.status
        if self._sink and self._cycler.measurement.current_A < 0.0:
            status |= {self._sink}
        if self._cycler.alarms:
            status |= set(self._map.alarm_bits)
        return status | {"lock_step"} if self._clock.lock_step else status

    def _ramp(self) -> float:
        ramp = self._cycler.ramp_A_per_s
        return self._commands.unlimited_ramp if ramp is None else ramp


def _bit_sum(bits: Mapping[str, int], names: frozenset[str] | set[str]) -> int:
    return sum(1 << bits[name] for name in names if name in bits)
