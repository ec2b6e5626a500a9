"""The mixed sweep that tells most of those that go through the window alike."""

from __future__ import annotations

import numpy as np

from models.design.constraints.feasible import Feasible
from models.design.coverage import NEAR_SOC
from models.design.information.experiment import Evaluator, Experiment
from models.design.optimise.block_design import DesignRequest, demands_of
from models.design.optimise.robust import robust_criterion
from models.design.sequence.excitation_sequence import ExcitationSequence
from models.design.sequence.mixed_sweep import mixed_sweep
from models.design.sequence.sequence_plan import SequencePlan

# Fewer levels ask for these, not for the window.
_LEAST_LEVELS = 3
# Draws cost what they are played with once in the model: tenths of a second each.
_DRAWS = 10


def swept(experiment: Experiment, request: DesignRequest, plan: SequencePlan) -> ExcitationSequence | None:
    """Choose among draws of the mixed sweep by the criterion.

    The information alone would choose the strongest currents; all draws have the same mean currents, sizes and way, so
    that it decides about no more than their random parts.

    Parameters
    ----------
    experiment, request : what is to be learnt
    plan : of the sequence with blocks, whose limits, ends and rests the sweep takes

    Returns
    -------
    ExcitationSequence or None
        None where blocks at levels are asked for, or serve better: few levels, a load cycle that bounds the currents,
        an accuracy that is to end the test early, a time too short for both ends, limits that bar the way to them.
    """
    if len(request.soc_levels) < _LEAST_LEVELS or request.cycle_A is not None or request.target_std is not None:
        return None
    best, best_value, feasible, objective = None, -np.inf, None, None
    for number in range(request.n_starts or _DRAWS):
        found = mixed_sweep(plan, request.active_s, request.seed + 1000 * number)
        if found is None:
            return None
        if feasible is None or objective is None:
            count = len(found.current_A)
            feasible = Feasible(experiment, demands_of(experiment, request.limits), count)
            criterion = robust_criterion(experiment, count, request.criterion, request.seed)
            objective = Evaluator(experiment, count, criterion) if isinstance(criterion, str) else criterion
        current_A = feasible.finish(found.current_A)
        value = objective.value(current_A) if _reaches_ends(plan, feasible, current_A) else -np.inf
        if value > best_value:
            best, best_value = found, value
    return best


def _reaches_ends(plan: SequencePlan, feasible: Feasible, current_A: np.ndarray) -> bool:
    """Whether what the limits have left of a sweep still goes to both ends."""
    assert plan.ends is not None  # no sweep without them
    soc = feasible.soc(current_A)
    return bool(soc.min() <= plan.ends[0] + NEAR_SOC and soc.max() >= plan.ends[1] - NEAR_SOC)
