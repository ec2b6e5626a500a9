"""What gives a run its set-points; and a profile on the grid of ticks: what each tick applies, and where it ends."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from drivers.cycler import Reading

# Times such as 3 * 0.1 fall a rounding error short of the grid.
_GRID_TOLERANCE = 1e-6


class SetPoints(Protocol):
    """What the loop plays: a profile, or a protocol that looks at each sample.

    Attributes
    ----------
    dt_s : float
        Period of the ticks.
    closed_loop : bool
        Whether set-points follow from what is measured.
    due : bool or None
        Whether the last sample is to be stored; None: as the run's sampling time says.
    chamber_degC : float or None
        Set point of the temperature chamber; None: it is left as it is.
    hold_V : float or None
        Voltage that the device is to hold with the last set-point as the greatest current.
    step_count, cycle_count : int
        That the last sample belongs to; 0 where there are none.
    stopped : str or None
        Why it could not be played to its end.
    view : mapping
        What plays now, for people.
    """

    @property
    def dt_s(self) -> float: ...  # noqa: D102
    @property
    def closed_loop(self) -> bool: ...  # noqa: D102
    @property
    def skipped_points(self) -> int: ...  # noqa: D102
    @property
    def due(self) -> bool | None: ...  # noqa: D102
    @property
    def hold_V(self) -> float | None: ...  # noqa: D102
    @property
    def chamber_degC(self) -> float | None: ...  # noqa: D102
    @property
    def step_count(self) -> int: ...  # noqa: D102
    @property
    def cycle_count(self) -> int: ...  # noqa: D102
    @property
    def stopped(self) -> str | None: ...  # noqa: D102
    @property
    def view(self) -> Mapping[str, Any]: ...  # noqa: D102

    def progress(self, tick: int) -> float:
        """Return the share that has been played."""
        ...

    def follow(self, tick: int, reading: Reading, time_s: float, soc: float | None) -> float | None:
        """Take a sample; return the set-point until the next tick, in A; None where there is nothing left to play."""
        ...

    def wait(self, time_s: float) -> None:
        """Pass over a sample during which somebody holds the run."""
        ...

    def skip(self) -> None:
        """End the step that plays."""
        ...

    def close(self) -> None:
        """The run ends."""
        ...

    def take_rows(self, time_s: float) -> Sequence[tuple[float, ...]]:
        """Return rows of the stream ``steps`` that have come since the last call."""
        ...


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
    closed_loop: bool = field(default=False, init=False)
    due: bool | None = field(default=None, init=False)
    hold_V: float | None = field(default=None, init=False)
    chamber_degC: float | None = field(default=None, init=False)
    step_count: int = field(default=0, init=False)
    cycle_count: int = field(default=0, init=False)
    stopped: str | None = field(default=None, init=False)
    view: Mapping[str, Any] = field(default_factory=dict, init=False)

    @property
    def n_ticks(self) -> int:
        """Number of periods; the last sample is number `n_ticks`, at rest again."""
        return len(self.setpoint_A)

    def setpoint(self, tick: int) -> float | None:
        """Return the set-point that tick `tick` applies, in A; None when the profile has ended."""
        return self.setpoint_A[tick] if tick < len(self.setpoint_A) else None

    def progress(self, tick: int) -> float:
        """Return the share of the profile that has been played."""
        return min(1.0, tick / self.n_ticks)

    def follow(self, tick: int, reading: Reading, time_s: float, soc: float | None) -> float | None:
        """See `SetPoints`; a profile does not look at what is measured."""
        return self.setpoint(tick)

    def wait(self, time_s: float) -> None:
        """See `SetPoints`."""

    def skip(self) -> None:
        """See `SetPoints`: a profile has no steps."""

    def close(self) -> None:
        """See `SetPoints`."""

    def take_rows(self, time_s: float) -> Sequence[tuple[float, ...]]:
        """See `SetPoints`."""
        return ()


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
