"""The whole test: optimised blocks at even levels of the charge, with what tells about relaxation around them.

After ch. 2.3.4 of the method: at each level a block of dynamic currents, before and after it a constant-current pulse
whose duration follows from the longest time constant, each followed by a rest of 8 times the pulse (at least 6); the
pulses also move the charge to the next level, their durations making up for what a block has carried away; all levels
once downwards and once upwards. Here a conditioning stage comes first, which clears the cell's short-time history, and
one block is repeated at the end, whose repeatability is measured against the noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.design.constraints.limitation import LimitationRatio, no_limitation
from models.design.constraints.limits import InfeasibleError, Limits, Window
from models.design.sequence.profile import Profile
from models.design.sequence.sequence_builder import PULSE_SHARE_OF_LIMIT, SequenceBuilder

LEAST_REST_RATIO, REST_RATIO = 6.0, 8.0
# A pulse lasts this share of the longest time constant: with the rest of eight pulses, relaxation is seen for one and a
# half time constants.
_PULSE_SHARE = 0.2
# Of the time that a test may take, for all rests together: pulses become shorter where it does not suffice.
_REST_SHARE = 0.1
# Of the largest current.
_CONDITIONING_SHARE = 0.5
_CONDITIONING_CYCLES = 2

# The largest mean current that a block is given to carry the charge on with, of the limits'. The rest is left to long
# pulses: slow relaxation and hysteresis show in constant currents, not in what a block can hold.
_CARRY_SHARE = 0.2

# Currents of a block from the state of charge that it begins at, its number, and by how much it is to move the charge.
BlockDesigner = Callable[[float, int, float], FloatArray]


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
        return max(1, round(_PULSE_SHARE * self.longest_s / self.dt_s)) * self.dt_s

    def carried_soc(self, number: int, soc: float) -> float:
        """How far a block moves the charge on towards the next level, so that no time is lost with moving alone.

        The pulses around the blocks take their part; the block before its own repetition, and the repetition, none.
        """
        visits = self.visits()
        if number + 1 + self.repeat >= len(visits):
            return self._possible(0.0)
        pulses = sum(self._pulse_soc(self.direction(each)) for each in (number, number + 1))
        change = visits[number + 1] - soc - pulses
        if change * (visits[number + 1] - soc) <= 0.0:
            return self._possible(0.0)
        low_A, high_A = self.limits.current_A
        most = _CARRY_SHARE * (high_A if change > 0.0 else -low_A) * self.block_s / 3600.0 / self.capacity_Ah
        return self._possible(float(np.clip(change, -most, most)))

    def _possible(self, change: float) -> float:
        """Nearest change that a block's bounds allow."""
        if self.mean_A is None:
            return change
        per_A = self.block_s / 3600.0 / self.capacity_Ah
        return float(np.clip(change, self.mean_A[0] * per_A, self.mean_A[1] * per_A))

    def direction(self, number: int) -> float:
        """Sign of the current with which a visit's level is reached."""
        return -1.0 if number < len(self.soc_levels) or len(self.soc_levels) == 1 else 1.0

    def _pulse_soc(self, sign: float) -> float:
        limit_A = self.limits.current_A[1] if sign > 0.0 else -self.limits.current_A[0]
        return sign * PULSE_SHARE_OF_LIMIT * limit_A * self.pulse_s / 3600.0 / self.capacity_Ah

    def visits(self) -> tuple[float, ...]:
        """States of charge of all blocks in their order: down, up, and the repeated one."""
        down, up = self.soc_levels[::-1], self.soc_levels[1:]
        return (*down, *up, *((up or down)[-1:] if self.repeat else ()))


@dataclass(frozen=True)
class Block:
    """Where a block of optimised currents lies in the sequence.

    Attributes
    ----------
    first, last : samples first to last - 1
    soc : at its beginning
    repeats : number of the block that it repeats, or None
    """

    first: int
    last: int
    soc: float
    repeats: int | None = None


@dataclass(frozen=True)
class ExcitationSequence:
    """A sequence ready to be played.

    Attributes
    ----------
    current_A : (N,) current_A[k] flows from k dt to (k + 1) dt
    dt_s : sampling time
    blocks : where the optimised currents lie
    charge_Ah, throughput_Ah : net and absolute charge
    """

    current_A: FloatArray
    dt_s: float
    blocks: tuple[Block, ...]

    @property
    def duration_s(self) -> float:
        """How long it takes."""
        return len(self.current_A) * self.dt_s

    @property
    def charge_Ah(self) -> float:
        """Net charge."""
        return float(self.current_A.sum()) * self.dt_s / 3600.0

    @property
    def throughput_Ah(self) -> float:
        """Charge moved, either way."""
        return float(np.abs(self.current_A).sum()) * self.dt_s / 3600.0

    def profile(self) -> Profile:
        """Rows for a bench; equal currents in one."""
        return compact_profile(self.current_A, self.dt_s)


def compact_profile(current_A: FloatArray, dt_s: float) -> Profile:
    """Profile of currents held for one sampling time each; equal ones share a row, and a last row at 0 A ends it."""
    starts = np.flatnonzero(np.concatenate([[True], np.diff(current_A) != 0.0]))
    # Multiples of dt, not a running sum: the grid of ticks must be met to the bit.
    time_s = np.append(starts, len(current_A)) * dt_s
    return Profile(time_s, np.append(current_A[starts], 0.0))


def build_sequence(
    plan: SequencePlan, design_block: BlockDesigner, enough: Callable[[FloatArray], bool] | None = None
) -> ExcitationSequence:
    """Put a sequence together.

    Parameters
    ----------
    plan : what it consists of
    design_block : gives the currents of a block; they begin and end at rest and keep the limits by themselves
    enough : asked after each visit with all currents so far, once every level has been visited; True ends the sequence

    Returns
    -------
    ExcitationSequence
    """
    builder = begin(plan)
    visits = plan.visits()
    blocks: list[Block] = []
    for number in range(len(visits)):
        repeats = number - 1 if plan.repeat and number == len(visits) - 1 else None
        if repeats is None:
            blocks.append(visit(builder, plan, number, design_block))
        else:
            again = builder.current_A()[blocks[repeats].first : blocks[repeats].last]
            block = visit(builder, plan, number, lambda soc, number, change, again=again: again)
            blocks.append(replace(block, repeats=repeats))
        # A model that has seen some levels only is no judge of the others.
        if enough is not None and number + 1 >= len(plan.soc_levels) and enough(builder.current_A()):
            break
    return ExcitationSequence(builder.current_A(), plan.dt_s, tuple(blocks))


def begin(plan: SequencePlan) -> SequenceBuilder:
    """Begin a sequence, with the stage that clears the short-time history where the plan has one."""
    builder = SequenceBuilder(plan.limits, plan.capacity_Ah, plan.initial_soc, plan.dt_s, plan.pulse_s, plan.ratio)
    if plan.conditioning:
        for _ in range(_CONDITIONING_CYCLES):
            for sign in (-1.0, 1.0):
                builder.pulse(sign, _CONDITIONING_SHARE, plan.pulse_s)
        builder.rest(plan.rest_ratio * plan.pulse_s)
    return builder


def visit(builder: SequenceBuilder, plan: SequencePlan, number: int, design_block: BlockDesigner) -> Block:
    """Append one visit: the way to its level, a rest, the block, a pulse and another rest."""
    rest_s = plan.rest_ratio * plan.pulse_s
    builder.approach(plan.visits()[number], plan.direction(number))
    builder.rest(rest_s)
    soc = builder.soc
    current = design_block(soc, number, plan.carried_soc(number, soc))
    first = builder.append(current)
    builder.rest(plan.dt_s)
    builder.pulse(plan.direction(number), PULSE_SHARE_OF_LIMIT, plan.pulse_s)
    builder.rest(rest_s)
    return Block(first, first + len(current), soc)


def estimated_duration_s(plan: SequencePlan) -> float:
    """Duration before any block is designed; blocks that move the charge by what they are asked to keep it exactly."""
    n, per_A = round(plan.block_s / plan.dt_s), plan.dt_s / 3600.0 / plan.capacity_Ah
    return build_sequence(plan, lambda soc, number, change: np.full(n, change / (n * per_A))).duration_s


def fitted_to(plan: SequencePlan, duration_s: float) -> SequencePlan:
    """Return the plan with the longest blocks that a duration leaves.

    Pulses keep their share of the longest time constant as long as the rests after them take no more than a tenth
    of the time; in a shorter test they are shorter.

    Raises
    ------
    InfeasibleError
        Pulses, rests and moves alone take longer; the message says how long.
    """
    n_rests = 2 * len(plan.visits()) + plan.conditioning
    most_s = _REST_SHARE * duration_s / (n_rests * plan.rest_ratio * _PULSE_SHARE)
    plan = replace(plan, longest_s=max(min(plan.longest_s, most_s), plan.dt_s))
    fixed_s = estimated_duration_s(replace(plan, block_s=plan.dt_s))
    if fixed_s > duration_s:
        raise InfeasibleError(
            f"duration is {duration_s:g} s without the rest at the end, but pulses, rests and moves between "
            f"{len(plan.soc_levels)} levels alone take {fixed_s:.0f} s: give more time, fewer soc_levels or a smaller "
            "rest_ratio"
        )
    least, most = 1, int(duration_s / (len(plan.visits()) * plan.dt_s)) + 1
    while most - least > 1:
        middle = (least + most) // 2
        if estimated_duration_s(replace(plan, block_s=middle * plan.dt_s)) <= duration_s:
            least = middle
        else:
            most = middle
    return replace(plan, block_s=least * plan.dt_s)
