"""What the rules look at."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Sample:
    """One fresh sample, without what is missing.

    Parameters
    ----------
    time_s, voltage_V, current_A, temperature_degC : float
        Positive current charges.
    """

    time_s: float
    voltage_V: float
    current_A: float
    temperature_degC: float
