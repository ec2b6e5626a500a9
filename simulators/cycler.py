"""The physics and the rules of a simulated cycler: set-point, limits, ramp, output, watchdog, measurements.

It knows neither registers nor sockets, and time only as what `advance` is told.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from simulators.cell import TruthCell
from simulators.held_voltage import held_current_A
from simulators.sensors import Measurement, MeasuringLayer

__all__ = ["Cycler", "CyclerSettings", "StateRefusedError", "ValueRefusedError"]

SEQUENCE_SPAN = 1 << 32
RAMP_STEPS = 100  # a ramp is a staircase of at most this many steps for each measurement
RAMP_STEP_S = 0.02
HOLD_STEPS = 20  # as many for a held voltage
HOLD_STEP_S = 0.5
OVER_CURRENT_SHARE = 0.02  # of the nominal current; sensor noise must not trip the output


class ValueRefusedError(Exception):
    """A value that this device never takes, or not with its present limits."""


class StateRefusedError(Exception):
    """A command that the device does not take in its present state."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CyclerSettings:
    """The device as it is switched on; its limits start at what its power stage can do."""

    nominal_current_A: float = 30.0
    nominal_voltage_V: float = 6.0
    watchdog_s: float = 2.0
    serial: int = 1
    firmware: int = 1
    ambient_degC: float = 25.0

    @property
    def constants(self) -> dict[str, float]:
        """The rating by the names that device maps have for it in their expressions."""
        return {
            "i_nom": self.nominal_current_A,
            "v_nom": self.nominal_voltage_V,
            "p_nom": self.nominal_current_A * self.nominal_voltage_V,
        }


class Cycler:
    """One channel with a cell on it.

    Parameters
    ----------
    settings : CyclerSettings
    cell : TruthCell
    sensors : MeasuringLayer
    watchdog_enabled : bool
        False where time moves only with the client (lock-step), as silence then takes no time.
    air_degC : Callable or None
        What is around the cell; None: the settings' constant temperature.

    Attributes
    ----------
    requested_A, set_point_A, current_A : float
        What was written, what is in force, and what flows; positive charges.
    limits : dict[str, float]
        ``voltage_high``, ``voltage_low``, ``current_high`` ... in V, A and degC. One that is broken at a
        measurement while the output is on trips the output and latches an alarm.
    hold_V : float or None
        Voltage that the device does not go beyond, by less current than its set-point; None: it holds the current.
    ramp_A_per_s : float or None
        None: the set-point is reached at once.
    alarms : set[str]
        Latched until cleared; none may be there when the output is switched on.
    stop_input : bool
        A button that is wired to the device is pressed; the device itself only tells of it.
    deaf : bool
        Set-points are taken without a complaint, but the old one stays in force (a fault).
    """

    def __init__(
        self,
        settings: CyclerSettings,
        cell: TruthCell,
        sensors: MeasuringLayer,
        *,
        watchdog_enabled: bool,
        air_degC: Callable[[], float] | None = None,
    ) -> None:
        self.settings = settings
        self.alarms: set[str] = set()
        self.limits: dict[str, float] = {}
        self.deaf = False
        self.stop_input = False
        self._cell = cell
        self._sensors = sensors
        self._watchdog_enabled = watchdog_enabled
        self._air_degC = air_degC or (lambda: settings.ambient_degC)
        self._switch_on()
        self._truth = cell.step(0.0, 0.0)
        self.measurement = self._measure()

    def restart(self) -> None:
        """Lose power and come back: everything that was told is forgotten, and the output is off."""
        self._switch_on()

    def _switch_on(self) -> None:
        settings = self.settings
        self.requested_A = self.set_point_A = self.current_A = 0.0
        self.output_on = self.remote = False
        self.alarms.clear()
        self.watchdog_s = settings.watchdog_s
        self.ramp_A_per_s: float | None = None
        self.hold_V: float | None = None
        self._holds = False
        self._flowed_A: float | None = None
        self.limits |= {
            "voltage_high": settings.nominal_voltage_V,
            "voltage_low": 0.0,
            "current_high": settings.nominal_current_A,
            "current_low": -settings.nominal_current_A,
            "temperature_high": 85.0,
            "temperature_low": -40.0,
        }
        self.sequence = 0
        self._heartbeat_left_s = self.watchdog_s

    @property
    def status(self) -> frozenset[str]:
        """Names of the status bits that are set."""
        names = set()
        if self.output_on:
            names.add("output_on")
            if abs(self.requested_A - self.current_A) > 1e-9:
                names.add("voltage_held" if self._holds else "current_limited")
        if self.remote:
            names.add("remote")
        if self.stop_input:
            names.add("stop_input")
        if "watchdog" in self.alarms:
            names.add("watchdog_expired")
        return frozenset(names)

    def check_set_point(self, current_A: float) -> None:
        """Say whether a set-point would be taken.

        Raises
        ------
        ValueRefusedError
            If it lies outside the device's current limits.
        StateRefusedError
            If it is not zero and the device is not in remote mode.
        """
        low, high = self.limits["current_low"], self.limits["current_high"]
        slack_A = 1e-6 * max(abs(low), abs(high))  # both may have been rounded to single precision
        if current_A != 0.0 and not low - slack_A <= current_A <= high + slack_A:
            raise ValueRefusedError(f"set-point {current_A} A is outside the device's current limits")
        if current_A != 0.0 and not self.remote:
            raise StateRefusedError(f"set-point {current_A} A while the device is not in remote mode")

    def set_current(self, current_A: float) -> None:
        """Take a checked set-point; it flows from the next advance on."""
        if self.deaf:
            return
        self.requested_A = self.set_point_A = current_A

    def set_limit(self, name: str, value: float) -> None:
        """Set one of `limits`; the set-point in force is held inside the current limits."""
        self.limits[name] = value
        low, high = self.limits["current_low"], self.limits["current_high"]
        held = min(max(self.requested_A, low), high)
        self.set_point_A = held if low <= high else 0.0

    def check_output(self, *, remote: bool, alarms: bool) -> None:
        """Say whether the output may be switched on, given remote mode and latched alarms.

        Raises
        ------
        StateRefusedError
            If the device is not in remote mode, or an alarm is latched.
        """
        if not remote:
            raise StateRefusedError("output on while the device is not in remote mode")
        if alarms:
            raise StateRefusedError(f"output on while alarms are latched: {', '.join(sorted(self.alarms))}")

    def set_output(self, on: bool) -> None:
        """Switch the output; switching off also forgets the set-point."""
        if on and not self.output_on:
            self._heartbeat_left_s = self.watchdog_s
        if not on:
            self.requested_A = self.set_point_A = self.current_A = 0.0
        self.output_on = on

    def set_remote(self, on: bool) -> None:
        """Take or give up remote mode; giving it up switches the output off."""
        self.remote = on
        if not on:
            self.set_output(False)

    def heartbeat(self) -> None:
        """Restart the communication watchdog."""
        self._heartbeat_left_s = self.watchdog_s

    def trip(self, alarm: str) -> None:
        """Latch an alarm and switch the output off."""
        self.alarms.add(alarm)
        self.set_output(False)

    def advance(self, dt_s: float, measurements: int = 1, speed: float = 1.0) -> None:
        """Let time pass, then measure and check the limits.

        Parameters
        ----------
        dt_s : float
            Simulated time.
        measurements : int
            How many measuring periods of the device lie in it: the sequence counter moves by as many, though
            only the last one is kept.
        speed : float
            Simulated seconds per second. The watchdog waits for a client, who lives on the wall clock, and so does it.
        """
        left = dt_s
        if self._watchdog_enabled and self.output_on:
            until_expiry_s = self._heartbeat_left_s * speed
            if until_expiry_s <= dt_s:
                self._play(until_expiry_s)
                left -= until_expiry_s
                self.trip("watchdog")
            else:
                self._heartbeat_left_s -= dt_s / speed
        self._play(left)
        seen = self._measure()
        if not self._sensors.frozen:
            self.sequence = (self.sequence + measurements) % SEQUENCE_SPAN
            self.measurement = seen
        if self.output_on:
            self._check_limits(self.measurement)

    def _play(self, dt_s: float) -> None:
        target = self.set_point_A if self.output_on else 0.0
        self._holds, self._flowed_A = False, None
        if self.hold_V is not None and target != 0.0:
            self._hold(self.hold_V, target, dt_s)
            return
        if self.ramp_A_per_s is None or self.current_A == target:
            self.current_A = target
            self._truth = self._cell.step(target, dt_s)
            return
        count = min(max(math.ceil(dt_s / RAMP_STEP_S), 1), RAMP_STEPS)
        most = self.ramp_A_per_s * dt_s / count
        for _ in range(count):
            gap = target - self.current_A
            self.current_A = target if abs(gap) <= most else self.current_A + math.copysign(most, gap)
            self._truth = self._cell.step(self.current_A, dt_s / count)

    def _hold(self, hold_V: float, set_A: float, dt_s: float) -> None:
        """Give what a fast controller of the voltage gives, in steps; measured is at the end, with the voltage held."""
        count = min(max(math.ceil(dt_s / HOLD_STEP_S), 1), HOLD_STEPS)
        most = math.inf if self.ramp_A_per_s is None else self.ramp_A_per_s * dt_s / count
        charge_As = 0.0
        for step_s in (*[dt_s / count] * count, 0.0):
            held_A = held_current_A(self._cell, hold_V, set_A)
            self._holds = held_A != set_A
            if step_s > 0.0:
                held_A = min(max(held_A, self.current_A - most), self.current_A + most)
            elif most < math.inf:
                held_A = self.current_A
            self.current_A = held_A
            self._truth = self._cell.step(held_A, step_s)
            charge_As += held_A * step_s
        # Measured is the mean: a current that falls is else counted too low, by a tenth of a percent of a charge.
        self._flowed_A = charge_As / dt_s if dt_s > 0.0 else None

    def _measure(self) -> Measurement:
        seen_A = self.current_A if self._flowed_A is None else self._flowed_A
        return self._sensors.measure(self._truth, seen_A, self._air_degC())

    def _check_limits(self, seen: Measurement) -> None:
        if not math.isfinite(seen.voltage_V) or not math.isfinite(seen.temperature_degC):
            self.trip("internal")
        limits, margin_A = self.limits, OVER_CURRENT_SHARE * self.settings.nominal_current_A
        if seen.voltage_V > limits["voltage_high"]:
            self.trip("over_voltage")
        if seen.voltage_V < limits["voltage_low"]:
            self.trip("under_voltage")
        if not limits["current_low"] - margin_A <= seen.current_A <= limits["current_high"] + margin_A:
            self.trip("over_current")
        if seen.temperature_degC > limits["temperature_high"]:
            self.trip("over_temperature")
        if seen.temperature_degC < limits["temperature_low"]:
            self.trip("under_temperature")
