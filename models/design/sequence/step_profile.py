"""Multi-level current steps with pulses and rests over the SoC range, down and up again.

At evenly spaced SoC levels: a block of random steps, a discharge and a charge pulse of equal charge, each followed by
a rest, then a constant current to the next level. Half of the plan discharges, half charges, so that both directions
are seen at every level.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.errors import ModelError
from models.design.sequence.profile import Profile

# The rest after a pulse over the pulse's duration; the method suggests at least 6 and uses 8 (ch. 2.3.4).
REST_RATIO = 8.0
_STEP_LEVELS = np.array([-1.0, -0.7, -0.4, -0.15, 0.0, 0.15, 0.4, 0.7, 1.0])
# Length of a random step: from the fast to the middle time constants of a cell.
_STEP_S = (3.0, 40.0)
# Share of a level's time for its parts; what remains moves the charge to the next level.
_PULSE_SHARE = 0.008
_STEP_SHARE = 0.3
# No step leaves the planned SoC by more than this: the window holds for the whole profile.
_SOC_MARGIN = 0.02


@dataclass(frozen=True)
class StepProfileRequest:
    """What the profile shall cover.

    Attributes
    ----------
    capacity_Ah : cell capacity
    current_A : (low, high) largest discharge (negative) and charge current
    soc : (low, high) window that the plan stays in
    initial_soc : where the cell stands
    duration_s : total time, with the rest at the end
    dt_s : set-points change on this grid
    n_levels : SoC levels in each direction
    final_rest_s : rest at the end, which leaves the cell without memory for the next run
    """

    capacity_Ah: float
    current_A: tuple[float, float]
    soc: tuple[float, float]
    initial_soc: float
    duration_s: float
    dt_s: float
    n_levels: int = 10
    final_rest_s: float = 0.0


def step_profile(request: StepProfileRequest, rng: np.random.Generator) -> Profile:
    """Build the profile.

    Parameters
    ----------
    request : limits and duration
    rng : orders the random steps; the same state gives the same profile

    Returns
    -------
    Profile

    Raises
    ------
    ModelError
        The limits contradict each other, or the time does not suffice for the charge to be moved.
    """
    _check(request)
    builder = _Builder(request)
    low, high = request.soc
    down = np.linspace(high - _SOC_MARGIN, low + _SOC_MARGIN, request.n_levels)
    levels = np.concatenate([down, down[-2::-1]])
    level_s = (request.duration_s - request.final_rest_s) / len(levels)
    for number, level in enumerate(levels):
        _level(builder, request, float(level), level_s, (number + 1) * level_s, rng)
    builder.rest(request.duration_s - builder.elapsed_s)
    return builder.profile()


def _level(
    builder: _Builder,
    request: StepProfileRequest,
    level: float,
    level_s: float,
    end_s: float,
    rng: np.random.Generator,
) -> None:
    """Move to the level, pulses and random steps there; done at `end_s`, the steps giving way to a long move."""
    pulse_s = max(_PULSE_SHARE * level_s, 2.0 * request.dt_s)
    steps_s = _STEP_SHARE * level_s
    fixed_s = steps_s + 2.0 * pulse_s * (1.0 + REST_RATIO)
    # Moved fast and then rested rather than slowly throughout: at one mild current the slow part of the response
    # cannot be told from the open-circuit curve.
    builder.move_to(level, rng.uniform(0.5, 1.0), max(end_s - builder.elapsed_s - fixed_s, request.dt_s))
    builder.rest(0.5 * (end_s - builder.elapsed_s - fixed_s))
    for sign in (-1.0, 1.0):
        limit = request.current_A[0] if sign < 0 else request.current_A[1]
        builder.hold(rng.uniform(0.5, 1.0) * limit, pulse_s)
        builder.rest(REST_RATIO * pulse_s)
    builder.random_steps(level, min(steps_s, end_s - builder.elapsed_s), rng)
    # What is left over is rest: the slow part of the relaxation shows only there.
    builder.rest(end_s - builder.elapsed_s)


class _Builder:
    """Appends segments and keeps the planned SoC inside the window."""

    def __init__(self, request: StepProfileRequest) -> None:
        self._request = request
        self._time_s = [0.0]
        self._current_A: list[float] = []
        self._soc = request.initial_soc

    @property
    def elapsed_s(self) -> float:
        return self._time_s[-1]

    def hold(self, current_A: float, duration_s: float) -> None:
        """Append a constant current, shortened where it would leave the SoC window."""
        dt = self._request.dt_s
        ticks = round(duration_s / dt)
        low, high = self._request.soc
        per_tick = current_A * dt / (3600.0 * self._request.capacity_Ah)
        if per_tick:
            room = (high - self._soc) if per_tick > 0 else (low - self._soc)
            ticks = min(ticks, int(max(room / per_tick, 0.0)))
        if ticks <= 0:
            return
        self._soc += ticks * per_tick
        self._current_A.append(float(current_A))
        # Multiples of dt, not a running sum: the grid of ticks must be met to the bit.
        self._time_s.append(round((self._time_s[-1] + ticks * dt) / dt) * dt)

    def rest(self, duration_s: float) -> None:
        self.hold(0.0, duration_s)

    def move_to(self, soc: float, share: float, duration_s: float) -> None:
        """Go to a SoC at a share of the largest current, faster where the time given demands it."""
        request = self._request
        needed_As = (soc - self._soc) * 3600.0 * request.capacity_Ah
        limit_A = request.current_A[1] if needed_As > 0 else request.current_A[0]
        current_A = np.sign(needed_As) * max(share * abs(limit_A), min(abs(needed_As) / duration_s, abs(limit_A)))
        if current_A:
            self.hold(current_A, needed_As / current_A)

    def random_steps(self, level: float, duration_s: float, rng: np.random.Generator) -> None:
        """Random levels and durations whose charge returns to the level."""
        request = self._request
        end_s = self.elapsed_s + duration_s
        while self.elapsed_s < end_s - request.dt_s:
            share = float(rng.choice(_STEP_LEVELS)) * float(rng.uniform(0.7, 1.0))
            away = self._soc - level
            if abs(away) > 0.5 * _SOC_MARGIN:
                share = -np.sign(away) * abs(share)
            limit = request.current_A[1] if share > 0 else -request.current_A[0]
            length_s = min(max(float(rng.uniform(*_STEP_S)), 2.0 * request.dt_s), end_s - self.elapsed_s)
            before = self.elapsed_s
            self.hold(share * limit, length_s)
            if self.elapsed_s == before:
                self.rest(request.dt_s)

    def profile(self) -> Profile:
        """Return the rows; a last row at 0 A ends the profile."""
        return Profile(np.array(self._time_s), np.array([*self._current_A, 0.0]))


def _check(request: StepProfileRequest) -> None:
    low_A, high_A = request.current_A
    low, high = request.soc
    if not low_A < 0.0 < high_A:
        raise ModelError(f"current limits {low_A:g}..{high_A:g} A must have 0 between them")
    if not 0.0 <= low < high <= 1.0 or high - low < 4.0 * _SOC_MARGIN:
        raise ModelError(f"SoC window {low:g}..{high:g} is empty or narrower than {4.0 * _SOC_MARGIN:g}")
    if not low <= request.initial_soc <= high:
        raise ModelError(f"the cell starts at SoC {request.initial_soc:g}, outside the window {low:g}..{high:g}")
    if not (request.dt_s > 0.0 and request.duration_s > 0.0 and request.capacity_Ah > 0.0):
        raise ModelError("duration, sampling time and capacity must be positive")
    way = 2.0 * (high - low) + high - request.initial_soc
    move_s = way * 3600.0 * request.capacity_Ah / min(-low_A, high_A)
    needed_s = move_s / max(1.0 - _STEP_SHARE - 2.0 * _PULSE_SHARE * (1.0 + REST_RATIO), 1e-9)
    needed_s += request.final_rest_s
    if request.duration_s < needed_s:
        rest = f" and to rest {request.final_rest_s:g} s" if request.final_rest_s else ""
        raise ModelError(
            f"{request.duration_s:g} s do not suffice to move SoC {low:g}..{high:g} down and up at "
            f"{low_A:g}..{high_A:g} A{rest}: at least {needed_s:.0f} s are needed"
        )
