"""What a sequence over states of charge consists of: its levels, the ends of its window, its pulses and their rests."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from models.data.errors import ModelError
from models.design.constraints.limitation import LimitationRatio, no_limitation
from models.design.constraints.limits import InfeasibleError, Limits, Window
from models.design.sequence.sequence_builder import FULL_PULSE, PULSE_SHARE_OF_LIMIT

LEAST_REST_RATIO, REST_RATIO = 6.0, 8.0
# A pulse lasts this share of the longest time constant: with the rest of eight pulses, relaxation is seen for one and a
# half time constants.
PULSE_SHARE_OF_TIME = 0.2
# The largest mean current that a block is given to carry the charge on with, of the limits', where a plan says nothing.
# The rest is left to long pulses: slow relaxation and hysteresis show in constant currents.
_CARRY_SHARE = 0.2


@dataclass(frozen=True)
class SequencePlan:
    """What the sequence consists of.

    Attributes
    ----------
    limits : current, window of the state of charge, ramp
    capacity_Ah, initial_soc : of the cell
    dt_s : sampling time
    soc_levels : rising levels at which blocks are played, once downwards and once upwards
    block_s : duration of one block
    longest_s : longest time constant of the cell
    ratio : how much of the largest current pulses and moves may take at each state of charge
    rest_ratio : rest after a pulse over the pulse's duration
    ends : lowest and highest state of charge, gone to beyond the levels before the way up and the way down; None: the
        levels are all
    end_rest_s : rest at these ends: the cell cools and comes to rest where its open-circuit curve is to begin
    carry_share : largest mean current of a block, of the limits', that carries the charge on to the next level
    gentle_share : currents of every second block, of the others'
    mean_A : range of the mean current of a block, where its bounds leave no more; None: whatever the limits do
    conditioning, repeat : whether the short-time history is cleared first, and one block repeated at the end
    """

    limits: Limits
    capacity_Ah: float
    initial_soc: float
    dt_s: float
    soc_levels: tuple[float, ...]
    block_s: float
    longest_s: float
    ratio: LimitationRatio = field(default_factory=no_limitation)
    rest_ratio: float = REST_RATIO
    ends: Window | None = None
    end_rest_s: float = 0.0
    carry_share: float = _CARRY_SHARE
    gentle_share: float = 1.0
    mean_A: Window | None = None
    conditioning: bool = True
    repeat: bool = True

    def __post_init__(self) -> None:
        """Check ranges."""
        low, high = self.limits.soc
        if not self.soc_levels or (np.diff(self.soc_levels) <= 0.0).any():
            raise ModelError("soc_levels must be rising states of charge, at least one")
        if not (low <= self.soc_levels[0] and self.soc_levels[-1] <= high and low <= self.initial_soc <= high):
            raise InfeasibleError(
                f"soc_levels {self.soc_levels[0]:g}..{self.soc_levels[-1]:g} and the start at SoC "
                f"{self.initial_soc:g} must lie within the limit soc {low:g}..{high:g}"
            )
        if self.rest_ratio < LEAST_REST_RATIO:
            raise InfeasibleError(
                f"rest_ratio is {self.rest_ratio:g}; at least {LEAST_REST_RATIO:g} is needed for relaxation to die out"
            )
        if not (self.block_s >= self.dt_s > 0.0 and self.longest_s > 0.0 and self.capacity_Ah > 0.0):
            raise InfeasibleError(
                f"duration: a block of {self.block_s:g} s at {self.dt_s:g} s holds no sample, or a time constant or "
                "the capacity is not positive"
            )

    @property
    def pulse_s(self) -> float:
        """Duration of a pulse that moves no charge on, whole samples."""
        return max(1, round(PULSE_SHARE_OF_TIME * self.longest_s / self.dt_s)) * self.dt_s

    def carried_soc(self, number: int, soc: float) -> float:
        """How far a block moves the charge on towards the next level, so that no time is lost with moving alone.

        The pulses around the blocks take their part; the block before its own repetition, and the repetition, none.
        """
        visits = self.visits()
        if number + 1 + self.repeat >= len(visits):
            return self._possible(0.0)
        end = self.end_before(number + 1)
        target = visits[number + 1] if end is None else end
        pulses = self._pulse_soc(self.direction(number), FULL_PULSE)
        pulses += self._pulse_soc(self.direction(number if end is not None else number + 1), PULSE_SHARE_OF_LIMIT)
        change = target - soc - pulses
        if change * (target - soc) <= 0.0:
            return self._possible(0.0)
        low_A, high_A = self.limits.current_A
        most_A = self.share_of(number) * self.carry_share * (high_A if change > 0.0 else -low_A)
        most = most_A * self.block_s / 3600.0 / self.capacity_Ah
        return self._possible(float(np.clip(change, -most, most)))

    def _possible(self, change: float) -> float:
        """Nearest change that a block's bounds allow."""
        if self.mean_A is None:
            return change
        per_A = self.block_s / 3600.0 / self.capacity_Ah
        return float(np.clip(change, self.mean_A[0] * per_A, self.mean_A[1] * per_A))

    def share_of(self, number: int) -> float:
        """Of the usual currents in a block: less in every second one, on the way back in those that had all."""
        down = number < len(self.soc_levels)
        return self.gentle_share if (number % 2 == 1) == down else 1.0

    def direction(self, number: int) -> float:
        """Sign of the current with which a visit's level is reached."""
        return -1.0 if number < len(self.soc_levels) or len(self.soc_levels) == 1 else 1.0

    def end_before(self, number: int) -> float | None:
        """End of the window that is gone to before a visit, beyond the levels: the upper one first, then the lower."""
        if self.ends is None:
            return None
        if number == 0 and self.ends[1] > self.soc_levels[-1]:
            return self.ends[1]
        return self.ends[0] if number == len(self.soc_levels) and self.ends[0] < self.soc_levels[0] else None

    def _pulse_soc(self, sign: float, share: float) -> float:
        limit_A = self.limits.current_A[1] if sign > 0.0 else -self.limits.current_A[0]
        return sign * share * limit_A * self.pulse_s / 3600.0 / self.capacity_Ah

    def visits(self) -> tuple[float, ...]:
        """States of charge of all blocks in their order: down, up, and the repeated one."""
        down, up = self.soc_levels[::-1], self.soc_levels[1:]
        return (*down, *up, *((up or down)[-1:] if self.repeat else ()))
