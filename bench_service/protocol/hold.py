"""A voltage held by the current alone: a tracking controller whose gain falls as the cell settles.

The voltage at the next sample is foreseen as the one now, plus the resistance times the change of the current, plus a
drift in proportion to the current that will flow; the current is the one with which that is the wanted voltage. A
drift in proportion to the current is what a filling cell has, and it makes a held current die away as it does. What is
foreseen is corrected by what is then measured: right after the beginning by nearly all of the difference, later by a
share that falls as one over the time since then, which is how fast a cell still changes. Without that the noise of the
voltage (1 mV over 20 mOhm are 50 mA) would be all over the current and end the step by chance.

While the current stands at a bound nothing is held: the drift is then the cell's own, and the hold begins when the
bound is left.
"""

from __future__ import annotations

import math

from bench_service.protocol.response import Response

_GAIN = 0.6
_SLOWEST_S = 60.0
_SLOPE_SHARE = 0.4
_YOUNG_SHARE = 0.5
# Drift after a jump of the current, of which nothing is known yet.
_AFTER_A_JUMP = 0.08
_LEAST_DROP_V = 0.005
_LARGE_V = 0.006
_GROWTH = 0.07
# Of the resistance, in one sample: no cell's voltage climbs more while its current is held.
_STEEPEST = 3.0
# An error beyond what noise makes: the hold begins anew.
_UPSET_V = 0.006
_UPSET_SAMPLES = 2
_UPSET_AGE_S = 4.0


class Hold:
    """Holds one voltage; belongs to one step.

    Parameters
    ----------
    voltage_V : float
    current_A : float
        In force when it begins.

    Attributes
    ----------
    settled : bool
        Whether the voltage is held, or the current stands at a bound: only then does the current say anything.
    """

    __slots__ = ("_age_s", "_foreseen_V", "_steepness", "_stepped_V", "_upset", "current_A", "settled", "voltage_V")

    def __init__(self, voltage_V: float, current_A: float) -> None:
        self.voltage_V = voltage_V
        self.current_A = current_A
        self.settled = False
        self._age_s = 0.0
        self._foreseen_V = voltage_V
        self._steepness = 0.0  # drift in one sample, over resistance times current
        self._stepped_V = 0.0
        self._upset = 0

    def follow(
        self, voltage_V: float, past_A: float, cell: Response, dt_s: float, bounds_A: tuple[float, float]
    ) -> float:
        """Return the current until the next sample.

        Parameters
        ----------
        voltage_V, past_A : float
            Measured voltage, and the set-point that was in force with it.
        cell : Response
        dt_s : float
            Until the next sample.
        bounds_A : (low, high)
            Of the current.
        """
        error_V = self.voltage_V - voltage_V
        self._upset = self._upset + 1 if abs(error_V) > _UPSET_V else 0
        if self._upset >= _UPSET_SAMPLES:
            self._age_s = min(self._age_s, _UPSET_AGE_S * dt_s)
        resistance_Ohm = cell.resistance_Ohm
        if abs(past_A - self.current_A) * resistance_Ohm > _LEAST_DROP_V:
            self._age_s = 0.0  # something else has moved the current: a ramp, a pause
        drop_V = math.copysign(max(abs(resistance_Ohm * past_A), _LEAST_DROP_V), past_A)
        gain = min(_GAIN, dt_s / min(max(_GROWTH * self._age_s, dt_s), _SLOWEST_S))
        if self._age_s == 0.0:
            gain = 1.0
            self._steepness = cell.drift_V_per_s * dt_s / drop_V if cell.drift_known and past_A else _AFTER_A_JUMP
        else:
            # What is surprising after a large step is the resistance, not the drift.
            share = (_YOUNG_SHARE if gain == _GAIN else _SLOPE_SHARE * gain) / (1 + (self._stepped_V / _LARGE_V) ** 2)
            self._steepness += share * gain * (voltage_V - self._foreseen_V) / drop_V
        self._steepness = min(max(self._steepness, 0.0), _STEEPEST)
        seen_V = self._foreseen_V + gain * (voltage_V - self._foreseen_V)
        wanted_A = (past_A + (self.voltage_V - seen_V) / resistance_Ohm) / (1.0 + self._steepness)
        held_A = min(max(wanted_A, bounds_A[0]), bounds_A[1])
        self._foreseen_V = seen_V + resistance_Ohm * (held_A - past_A + self._steepness * held_A)
        self._stepped_V = resistance_Ohm * (held_A - past_A)
        self._age_s = self._age_s + dt_s if held_A == wanted_A else 0.0
        self.settled = abs(error_V) < _UPSET_V or held_A != wanted_A
        self.current_A = held_A
        return held_A
