"""A voltage held by the device: which set-point it gets as its greatest current, and whether it holds.

A device holds in one direction at a time: it gives less current than it was told, and never the opposite one. Where
both directions are wanted it is turned round once its current has gone to nothing and the voltage is still beyond.
"""

from __future__ import annotations

_NEAR_V = 0.006
_BEYOND_V = 0.002
_SAMPLES = 3
_NOTHING = 0.01  # of the greatest current


class DeviceHold:
    """Holds one voltage; belongs to one step.

    Parameters
    ----------
    voltage_V : float
    bounds_A : (low, high)
        Greatest currents of either direction.

    Attributes
    ----------
    held : int
        Samples in a row in which the voltage was held.
    """

    __slots__ = ("_beyond", "_bounds_A", "_sign", "held", "voltage_V")

    def __init__(self, voltage_V: float, bounds_A: tuple[float, float]) -> None:
        self.voltage_V = voltage_V
        self.held = 0
        self._bounds_A = bounds_A
        self._sign = 0
        self._beyond = 0

    @property
    def settled(self) -> bool:
        """Whether the current says anything."""
        return self.held >= _SAMPLES

    def follow(self, voltage_V: float, current_A: float) -> float:
        """Return the greatest current until the next sample, from what was measured."""
        low_A, high_A = self._bounds_A
        if self._sign == 0:
            charges = high_A > 0.0 and (low_A == 0.0 or voltage_V <= self.voltage_V)
            self._sign = 1 if charges else -1
        beyond_V = (voltage_V - self.voltage_V) * self._sign
        spent = abs(current_A) <= _NOTHING * max(high_A, -low_A) and beyond_V > _BEYOND_V
        self._beyond = self._beyond + 1 if spent else 0
        if self._beyond >= _SAMPLES and (low_A if self._sign > 0 else high_A) != 0.0:
            self._sign, self._beyond = -self._sign, 0
        self.held = self.held + 1 if beyond_V > -_NEAR_V else 0
        return high_A if self._sign > 0 else low_A
