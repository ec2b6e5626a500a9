"""A profile on the grid of ticks: which set-point each tick applies, and where the profile ends."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

# Times such as 3 * 0.1 fall a rounding error short of the grid.
_GRID_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class Player:
    """Set-points of a profile, one per tick.

    Parameters
    ----------
    setpoint_A : tuple of float, length n
        Set-point that tick k applies; it flows from sample k to sample k + 1.
    dt_s : float
        Period of the ticks.
    skipped_points : int
        Points of the profile that no tick falls on: steps shorter than a period.
    """

    setpoint_A: tuple[float, ...]
    dt_s: float
    skipped_points: int

    @property
    def n_ticks(self) -> int:
        """Number of periods; the last sample is number `n_ticks`, at rest again."""
        return len(self.setpoint_A)

    def setpoint(self, tick: int) -> float | None:
        """Return the set-point that tick `tick` applies, in A; None when the profile has ended."""
        return self.setpoint_A[tick] if tick < len(self.setpoint_A) else None


def make_player(time_s: ArrayLike, current_A: ArrayLike, dt_s: float) -> Player:
    """Put a profile on the grid of ticks.

    A value holds from its time to the next point's (forward hold), the last point ends the profile. A point
    between two ticks takes effect at the later one; the end is the last tick not after the last point, so that no
    current flows longer than the profile says.

    Parameters
    ----------
    time_s : array_like, shape (n,)
        Strictly increasing.
    current_A : array_like, shape (n,)
        Positive charges.
    dt_s : float

    Raises
    ------
    ValueError
        Fewer than two points, values not finite, times not increasing, or shorter than one period.
    """
    time, current = np.asarray(time_s, np.float64), np.asarray(current_A, np.float64)
    if time.ndim != 1 or time.shape != current.shape or len(time) < 2:
        raise ValueError(f"profile has shapes {time.shape} and {current.shape}; two or more points are needed")
    if not (np.isfinite(time).all() and np.isfinite(current).all() and 0 < dt_s < np.inf):
        raise ValueError("profile and period must be finite numbers, the period above 0 s")
    if not (np.diff(time) > 0).all():
        at = int(np.argmin(np.diff(time) > 0)) + 1
        raise ValueError(f"time_s[{at}] = {time[at]:g} s is not after {time[at - 1]:g} s; times must increase")
    ticks = (time - time[0]) / dt_s
    n_ticks = int(np.floor(ticks[-1] + _GRID_TOLERANCE))
    if n_ticks < 1:
        raise ValueError(f"profile of {time[-1] - time[0]:g} s is shorter than one period of {dt_s:g} s")
    point = np.searchsorted(ticks, np.arange(n_ticks) + _GRID_TOLERANCE, side="right") - 1
    skipped = len(time) - 1 - len(np.unique(point))
    return Player(tuple(current[point].tolist()), dt_s, skipped)
