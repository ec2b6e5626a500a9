"""Which current a step wants until the next sample; one function a law, all with the same arguments."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

from bench_service.protocol.device_hold import DeviceHold
from bench_service.protocol.hold import Hold
from bench_service.protocol.program import Play, Window
from bench_service.protocol.response import Response

_SETTLING_SAMPLES = 3
_GRID_TOLERANCE = 0.05  # of a period: ticks of a wall clock are a little early or late


@dataclass(frozen=True, slots=True)
class Seen:
    """One sample, and the time since the one before.

    Parameters
    ----------
    soc : float or None
        Counted; None where nobody knows where it began.
    ambient_degC : float
        Around the cell; NaN where nobody measures it.
    """

    voltage_V: float
    current_A: float
    temperature_degC: float
    soc: float | None
    interval_s: float
    ambient_degC: float = math.nan


class Law:
    """The set-points of one step.

    Attributes
    ----------
    hold : Hold or None
        Where a voltage is held.
    held : int
        Samples since the hold began.
    by_device : DeviceHold or None
        Where the device holds it.
    """

    __slots__ = ("_cell", "_dt_s", "_play", "_window", "by_device", "held", "hold")

    def __init__(self, play: Play, window: Window, cell: Response, dt_s: float, *, device_holds: bool = False) -> None:
        self._play = play
        self._window = window
        self._cell = cell
        self._dt_s = dt_s
        self.hold: Hold | None = None
        self.held = 0
        self.by_device = None
        if device_holds and play.law in ("voltage", "cc_cv"):
            self.by_device = DeviceHold(play.voltage_V, self._bounds_A())

    @property
    def hold_V(self) -> float | None:
        """Voltage that the device is to hold."""
        return None if self.by_device is None else self.by_device.voltage_V

    @property
    def device_rules(self) -> bool:
        """Whether the current is what the device makes of it."""
        return self.by_device is not None and self.by_device.held > 0

    @property
    def current_counts(self) -> bool:
        """Whether the current may end the step: in a hold only when it holds."""
        if self.by_device is not None:
            return self.by_device.settled
        if self.hold is None:
            return self._play.law != "cc_cv"
        return self.held >= _SETTLING_SAMPLES and self.hold.settled

    def current_A(self, seen: Seen, time_s: float, last_A: float) -> float:
        """Return the current until the next sample.

        Parameters
        ----------
        seen : Seen
        time_s : float
            Since the step began.
        last_A : float
            The set-point in force.
        """
        return self._inside(self._wanted_A(seen, time_s, last_A))

    def _wanted_A(self, seen: Seen, time_s: float, last_A: float) -> float:
        law, play = self._play.law, self._play
        if self.by_device is not None:
            return self.by_device.follow(seen.voltage_V, seen.current_A)
        if law == "current":
            return play.level
        if law == "rest":
            return 0.0
        if law == "cc_cv":
            return self._cc_cv(seen, last_A)
        if law == "voltage":
            return self._held(seen, last_A)
        if law == "power":
            return self._powered(seen, play.level, last_A)
        if law == "resistance":
            return -max(seen.voltage_V, 0.0) / play.level
        return self._clipped(seen, self.profile(time_s, seen, last_A), last_A)

    def profile(self, time_s: float, seen: Seen, last_A: float) -> float:
        """Return the value of the step's profile; the last one ends it and is never played, however short the step."""
        at = bisect_right(self._play.times_s, time_s + _GRID_TOLERANCE * self._dt_s) - 1
        value = self._play.values[min(max(at, 0), len(self._play.values) - 2)]
        return self._powered(seen, value, last_A) if self._play.in_watts else value

    def _inside(self, current_A: float) -> float:
        """Return what the run's limits leave of a current; rest is always allowed."""
        low, high = self._window.current_A
        return min(max(current_A, min(low, 0.0)), max(high, 0.0))

    def _powered(self, seen: Seen, power_W: float, last_A: float) -> float:
        """Return the current of a power, at the voltage that this current leads to."""
        voltage_V = max(seen.voltage_V, 1e-3)
        moved_V = self._cell.resistance_Ohm * (power_W / voltage_V - last_A)
        return power_W / max(voltage_V + moved_V, 0.5 * voltage_V)

    def _cc_cv(self, seen: Seen, last_A: float) -> float:
        play, cell = self._play, self._cell
        if self.hold is None:
            jump_A = play.level - last_A
            ahead_V = seen.voltage_V + cell.drift_V_per_s * self._dt_s + cell.resistance_Ohm * jump_A
            if (play.voltage_V - ahead_V) * play.level > 0:
                return play.level
        return self._held(seen, last_A)

    def _bounds_A(self) -> tuple[float, float]:
        """Return between which currents a voltage is held."""
        level_A = self._play.level
        if self._play.law == "cc_cv":
            return min(level_A, 0.0), max(level_A, 0.0)
        low_A, high_A = self._window.current_A
        return max(-level_A, low_A), min(level_A, high_A)

    def _held(self, seen: Seen, last_A: float) -> float:
        if self.hold is None:
            self.hold = Hold(self._play.voltage_V, last_A)
        self.held += 1
        return self.hold.follow(seen.voltage_V, last_A, self._cell, self._dt_s, self._bounds_A())

    def _clipped(self, seen: Seen, current_A: float, last_A: float) -> float:
        """Take back what would lead out of the step's own window of voltage."""
        clip = self._play.clip_voltage_V
        if clip is None:
            return current_A
        cell = self._cell
        low_A, high_A = (
            last_A + (end - seen.voltage_V) / cell.resistance_Ohm if math.isfinite(end) else end for end in clip
        )
        # A cell that is beyond its window already is brought back to rest, never driven the other way.
        return min(max(current_A, min(low_A, 0.0)), max(high_A, 0.0))
