"""What stays the same during a run: its limits and tolerances."""

from dataclasses import dataclass

from bench_service.bench.limits import Limits

# The coulomb counter starts at a stated value and integrates the sensor's offset: half a percent is no violation.
SOC_TOLERANCE = 0.005
# Share of the commanded current by which a calibrated cycler may be off.
CURRENT_GAIN_TOLERANCE = 0.01


@dataclass(frozen=True, slots=True)
class Rules:
    """What stays the same during a run.

    Parameters
    ----------
    bench : str
        Name for the messages.
    limits : Limits
    current_tolerance_A : float
        Allowed error of the measured current, without the share of the commanded one.
    max_age_s : float
        Oldest fresh reading on which the output may stay on.
    tick_s : float
        Period of the checks; the run's duration may pass its limit by one.
    stale_limit : int
        Stale readings in a row that end the run.
    has_sequence : bool
        Whether the device counts its measurements; without it staleness cannot be seen.
    resistance_Ohm : tuple of float or None
        Band of the cell's type; None: what follows from the capacity.
    """

    bench: str
    limits: Limits
    current_tolerance_A: float
    max_age_s: float
    tick_s: float
    stale_limit: int = 3
    has_sequence: bool = True
    resistance_Ohm: tuple[float, float] | None = None
