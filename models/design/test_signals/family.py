"""What a family of test signals is, and what it is asked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.design.constraints.limits import Window


@dataclass(frozen=True)
class FamilyRequest:
    """What a family of signals is asked for.

    Attributes
    ----------
    current_A, soc : (low, high) limits
    capacity_Ah : of the cell
    initial_soc : where it stands
    duration_s, dt_s : of the whole signal and of one sample
    cycle_A : (n,) recorded load cycle at `dt_s`, for the families that replay one
    """

    current_A: Window
    soc: Window
    capacity_Ah: float
    initial_soc: float
    duration_s: float
    dt_s: float
    cycle_A: FloatArray | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Check ranges."""
        if not (self.dt_s > 0.0 and self.capacity_Ah > 0.0 and np.isfinite(self.duration_s)):
            raise ModelError("signal: sampling time and capacity must be positive and the duration finite")
        if self.n_samples < 1:
            raise ModelError(f"signal: a duration of {self.duration_s:g} s holds no sample of {self.dt_s:g} s")
        if not self.current_A[0] < 0.0 < self.current_A[1]:
            raise ModelError(f"signal: current_A is {self.current_A[0]:g}..{self.current_A[1]:g} A; 0 must lie between")

    @property
    def n_samples(self) -> int:
        """Whole sampling times in the duration."""
        return round(self.duration_s / self.dt_s)

    @property
    def amplitude_A(self) -> float:
        """Largest current that is allowed both ways."""
        return min(-self.current_A[0], self.current_A[1])

    def samples(self, duration_s: float) -> int:
        """Samples in a duration, at least one."""
        return max(1, round(duration_s / self.dt_s))

    def charge_Ah(self, soc: float) -> float:
        """Charge that changes the state of charge by a difference."""
        return soc * self.capacity_Ah


@dataclass(frozen=True)
class Family:
    """One family of test signals.

    Attributes
    ----------
    name : as a request names it
    title : one line for people, with its source
    build : (N,) currents from a request; random parts come from the generator. What limits remain (ramp, voltage) the
        caller imposes.
    """

    name: str
    title: str
    build: Callable[[FamilyRequest, np.random.Generator], FloatArray]


def sweep_A(request: FamilyRequest, share: float = 0.5) -> FloatArray:
    """Mean current that carries the cell through its window once down and once up, as far as the time allows.

    Dynamic signals are laid over it: around one state of charge they would see one local model only. Where the time
    does not suffice at a share of the largest current, the way is shortened at both ends.

    Parameters
    ----------
    request : window, limits, duration
    share : of the largest current that the mean may take

    Returns
    -------
    (N,) in A, of one size and three signs: down, up, back to the start
    """
    low, high = request.soc
    start = min(max(request.initial_soc, low), high)
    ways = np.array([start - low, high - low, high - start])
    most_A = share * request.amplitude_A
    time_s = 3600.0 * request.capacity_Ah * float(ways.sum()) / most_A
    size_A = most_A * min(1.0, time_s / request.duration_s)
    counts = np.round(np.cumsum(ways) / max(float(ways.sum()), 1e-12) * request.n_samples).astype(int)
    k = np.arange(request.n_samples)
    return size_A * np.where(k < counts[0], -1.0, np.where(k < counts[1], 1.0, -1.0))


def held(values: FloatArray, counts: np.ndarray, n_samples: int) -> FloatArray:
    """Hold each value for a count of samples; cut, or filled with 0, to `n_samples`."""
    out = np.zeros(n_samples)
    whole = np.repeat(values, counts)[:n_samples]
    out[: len(whole)] = whole
    return out


class Sequence:
    """Appends constant currents until the time is used up, keeping count of the state of charge."""

    def __init__(self, request: FamilyRequest) -> None:
        self.request = request
        self.soc = request.initial_soc
        self._current_A = np.zeros(request.n_samples)
        self._at = 0

    @property
    def full(self) -> bool:
        """Whether the time is used up."""
        return self._at >= len(self._current_A)

    def hold(self, current_A: float, duration_s: float) -> None:
        """Append a current, shortened where it would leave the window."""
        per_sample = current_A * self.request.dt_s / 3600.0 / self.request.capacity_Ah
        count = min(self.request.samples(duration_s), len(self._current_A) - self._at)
        if per_sample:
            edge = self.request.soc[1] if per_sample > 0.0 else self.request.soc[0]
            count = min(count, int(max((edge - self.soc) / per_sample, 0.0)))
        self._current_A[self._at : self._at + count] = current_A
        self._at += count
        self.soc += count * per_sample

    def move(self, soc: float, current_A: float) -> None:
        """Move by a difference of the state of charge at a size of the current."""
        self.hold(np.sign(soc) * current_A, abs(soc) * 3600.0 * self.request.capacity_Ah / current_A)

    def current_A(self) -> FloatArray:
        """Return the (N,) currents; what is left over is rest."""
        return self._current_A.copy()
