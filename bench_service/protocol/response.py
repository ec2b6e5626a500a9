"""How a cell answers: resistance and drift, estimated from the samples of the run itself."""

from __future__ import annotations

import math

# Before any step of the current was seen: of the voltage, at a current of 1C. Rather too much: a resistance that is
# taken too high makes a hold slow, one too low makes it swing.
_PRIOR_SHARE = 0.03
_LEAST_STEP_C = 0.02
_LARGE_STEP_C = 0.4
_DRIFT_OVER_S = 3.0
_LARGEST_SHARE = 0.3


class Response:
    """Estimates of one cell; belongs to one run.

    Parameters
    ----------
    capacity_Ah : float

    Attributes
    ----------
    resistance_Ohm : float
        Change of the voltage from one sample to the next, over that of the current.
    known : bool
        Whether a step of the current has been seen.
    drift_V_per_s : float
        How the voltage moves while the current stays.
    drift_known : bool
        Whether that has been seen since the current has last jumped.
    """

    __slots__ = ("_capacity_Ah", "_current_A", "_voltage_V", "drift_V_per_s", "drift_known", "known", "resistance_Ohm")

    def __init__(self, capacity_Ah: float) -> None:
        self._capacity_Ah = capacity_Ah
        self._current_A = self._voltage_V = math.nan
        self.resistance_Ohm = math.nan
        self.drift_V_per_s = 0.0
        self.known = self.drift_known = False

    def see(self, voltage_V: float, current_A: float, interval_s: float) -> None:
        """Take one sample; `interval_s` is the time since the one before."""
        if math.isnan(self.resistance_Ohm):
            self.resistance_Ohm = _PRIOR_SHARE * abs(voltage_V) / self._capacity_Ah
        elif interval_s > 0 and not math.isnan(self._voltage_V):
            step_A = current_A - self._current_A
            moved_V = voltage_V - self._voltage_V
            if abs(step_A) > _LEAST_STEP_C * self._capacity_Ah:
                self._learn(step_A, moved_V - self.drift_V_per_s * interval_s, abs(voltage_V))
            else:
                moved_V -= self.resistance_Ohm * step_A
                share = 1.0 - math.exp(-interval_s / _DRIFT_OVER_S)
                self.drift_V_per_s += share * (moved_V / interval_s - self.drift_V_per_s)
                self.drift_known = True
        self._voltage_V, self._current_A = voltage_V, current_A

    def look_away(self) -> None:
        """Samples are missing: the next one is not compared with the last one."""
        self._voltage_V = math.nan
        self.forget_drift()

    def forget_drift(self) -> None:
        """The current is about to jump: what the voltage did before says nothing any more."""
        self.drift_V_per_s, self.drift_known = 0.0, False

    def _learn(self, step_A: float, moved_V: float, voltage_V: float) -> None:
        seen_Ohm = moved_V / step_A
        if not 0.0 < seen_Ohm < _LARGEST_SHARE * voltage_V / self._capacity_Ah:
            return
        # A large step tells the resistance well, a small one is mostly noise.
        share = min(1.0, abs(step_A) / (_LARGE_STEP_C * self._capacity_Ah))
        self.resistance_Ohm += share * (0.5 if self.known else 1.0) * (seen_Ohm - self.resistance_Ohm)
        self.known = self.known or share > 0.5
