"""The whole test: optimised blocks at even levels of the charge, with what tells about relaxation around them.

After ch. 2.3.4 of the method: at each level a block of dynamic currents, before and after it a constant-current pulse
whose duration follows from the longest time constant, each followed by a rest of 8 times the pulse (at least 6); the
pulses also move the charge to the next level, their durations making up for what a block has carried away; all levels
once downwards and once upwards. Here a conditioning stage comes first, which clears the cell's short-time history, and
one block is repeated at the end, whose repeatability is measured against the noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from models.data.timeseries import FloatArray
from models.design.constraints.limits import InfeasibleError
from models.design.sequence.profile import Profile
from models.design.sequence.sequence_builder import FULL_PULSE, SequenceBuilder
from models.design.sequence.sequence_plan import PULSE_SHARE_OF_TIME, SequencePlan

# Of the time that a test may take, for all rests together: pulses become shorter where it does not suffice.
_REST_SHARE = 0.1
# Of the time that blocks have without the window's ends; what the way to these may leave them.
_LEAST_OF_BLOCKS = 1.0 / 3.0
# Of the largest current.
_CONDITIONING_SHARE = 0.5
_CONDITIONING_CYCLES = 2

# Currents of a block from the state of charge that it begins at, its number, and by how much it is to move the charge.
BlockDesigner = Callable[[float, int, float], FloatArray]


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
    """Append one visit: the way to its level, a rest, the block, a pulse and another rest.

    Before the first on the way down and on the way up, the end of the window and a rest there.
    """
    rest_s, end = plan.rest_ratio * plan.pulse_s, plan.end_before(number)
    if end is not None:
        builder.reach(end)
        builder.rest(max(rest_s, plan.end_rest_s))
    builder.approach(plan.visits()[number], plan.direction(number))
    builder.rest(rest_s)
    soc = builder.soc
    current = design_block(soc, number, plan.carried_soc(number, soc))
    first = builder.append(current)
    builder.rest(plan.dt_s)
    builder.pulse(plan.direction(number), FULL_PULSE, plan.pulse_s)
    builder.rest(rest_s)
    return Block(first, first + len(current), soc)


def estimated_duration_s(plan: SequencePlan) -> float:
    """Duration before any block is designed; blocks that move the charge by what they are asked to keep it exactly."""
    n, per_A = round(plan.block_s / plan.dt_s), plan.dt_s / 3600.0 / plan.capacity_Ah
    return build_sequence(plan, lambda soc, number, change: np.full(n, change / (n * per_A))).duration_s


def fitted_to(plan: SequencePlan, duration_s: float) -> SequencePlan:
    """Return the plan with the longest blocks that a duration leaves.

    Pulses keep their share of the longest time constant as long as the rests after them take no more than a tenth
    of the time; in a shorter test they are shorter. Where the way to the window's ends would leave the blocks less than
    a third of the time that they have without it, the ends are left out.

    Raises
    ------
    InfeasibleError
        Pulses, rests and moves alone take longer; the message says how long.
    """
    if plan.ends is not None:
        bare = fitted_to(replace(plan, ends=None), duration_s)
        try:
            whole = _filled(plan, duration_s)
        except InfeasibleError:
            return bare
        return whole if whole.block_s >= _LEAST_OF_BLOCKS * bare.block_s else bare
    return _filled(plan, duration_s)


def _filled(plan: SequencePlan, duration_s: float) -> SequencePlan:
    n_rests = 2 * len(plan.visits()) + plan.conditioning + 2 * (plan.ends is not None)
    most_s = _REST_SHARE * duration_s / (n_rests * plan.rest_ratio * PULSE_SHARE_OF_TIME)
    plan = replace(plan, longest_s=max(min(plan.longest_s, most_s), plan.dt_s))
    fixed_s = estimated_duration_s(replace(plan, block_s=plan.dt_s))
    if fixed_s > duration_s:
        raise InfeasibleError(
            f"duration is {duration_s:g} s without the rest at the end, but pulses, rests and moves between "
            f"{len(plan.soc_levels)} levels alone take {fixed_s:.0f} s: give more time, fewer soc_levels, a smaller "
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
