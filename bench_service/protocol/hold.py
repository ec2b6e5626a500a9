"""A voltage held by the current alone: a tracking controller whose gain falls as the cell settles.

The current is moved by the error over the cell's resistance. Right after the beginning the gain is high (what the
resistance leaves over is brought in within a few samples), later it falls as one over the time since then, which is
how fast a cell still changes; a second integrator follows the steady fall of the current, so that no error stays.
Without that the noise of the voltage (1 mV over 20 mOhm are 50 mA) would be all over the current and end the step by
chance. The current never leaves its bounds; while it stands at one nothing is integrated.
"""

from __future__ import annotations

from bench_service.protocol.response import Response

_FIRST_GAIN = 0.6
_SLOWEST_S = 60.0
_SLOPE_SHARE = 0.4
_GROWTH = 0.07
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

    __slots__ = ("_age_s", "_slope_A_per_s", "_upset", "current_A", "settled", "voltage_V")

    def __init__(self, voltage_V: float, current_A: float) -> None:
        self.voltage_V = voltage_V
        self.current_A = current_A
        self.settled = False
        self._age_s = 0.0
        self._slope_A_per_s = 0.0
        self._upset = 0

    def follow(self, voltage_V: float, cell: Response, dt_s: float, low_A: float, high_A: float) -> float:
        """Return the current until the next sample.

        Parameters
        ----------
        voltage_V : float
            Measured with the last current in force.
        cell : Response
        dt_s : float
            Until the next sample.
        low_A, high_A : float
            Bounds of the current.
        """
        error_V = self.voltage_V - voltage_V
        self._upset = self._upset + 1 if abs(error_V) > _UPSET_V else 0
        if self._upset >= _UPSET_SAMPLES:
            self._age_s = min(self._age_s, _UPSET_AGE_S * dt_s)
        if self._age_s == 0.0:
            error_V -= cell.drift_V_per_s * dt_s  # where the last current would take it
            self._slope_A_per_s = -cell.drift_V_per_s / cell.resistance_Ohm
        window_s = min(max(_GROWTH * self._age_s, dt_s), _SLOWEST_S)
        gain = min(_FIRST_GAIN, dt_s / window_s)
        step_A = error_V / cell.resistance_Ohm
        wanted_A = self.current_A + self._slope_A_per_s * dt_s * (self._age_s > 0.0) + gain * step_A
        self._age_s += dt_s
        held_A = min(max(wanted_A, low_A), high_A)
        if held_A != wanted_A:
            self._slope_A_per_s = 0.0
        elif abs(error_V) < _UPSET_V:
            # A held current dies away. One that still rises is on its way to the voltage, and must not be urged on.
            slope = self._slope_A_per_s + _SLOPE_SHARE * gain * gain * step_A / dt_s
            self._slope_A_per_s = 0.0 if slope * held_A > 0 else slope
        elif self._slope_A_per_s * step_A < 0:
            self._slope_A_per_s *= 0.5  # it leads away from the voltage
        self.settled = abs(error_V) < _UPSET_V or held_A != wanted_A
        self.current_A = held_A
        return held_A
