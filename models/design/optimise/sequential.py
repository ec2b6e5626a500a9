"""Design, play, refit, design again: each block from the model that the blocks before it have given.

The test ends when every parameter is known as well as asked for, which may be hours before the plan's end.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray, TimeSeries
from models.design.constraints.limits import InfeasibleError
from models.design.information.coloured import told_information
from models.design.information.experiment import Experiment
from models.design.information.parameters import parameter_std
from models.design.optimise.ascent import Optimum, Progress
from models.design.optimise.block_design import DesignRequest, block_designer, plan_of
from models.design.sequence.excitation_sequence import begin, estimated_duration_s, visit
from models.design.sequence.sequence_builder import SequenceBuilder
from models.design.sequence.sequence_plan import SequencePlan
from models.network.local_model_network import LocalModelNetwork

# Plays currents from a state of charge and gives what was measured.
Play = Callable[[FloatArray, float], TimeSeries]
# Fits a network to all that was measured so far, with the state of charge at the start of each run.
Refit = Callable[[list[TimeSeries], list[float]], LocalModelNetwork]


@dataclass(frozen=True)
class Round:
    """One visit that was played.

    Attributes
    ----------
    soc : at its beginning
    current_A : (n,) moves, pulses and rests included
    largest_std, mean_std : of the parameters after it, normalised units; the mean is geometric
    """

    soc: float
    current_A: FloatArray
    largest_std: float
    mean_std: float


@dataclass(frozen=True)
class SequentialResult:
    """What a sequential test has come to.

    Attributes
    ----------
    network : the last model
    rounds : in their order
    reached : whether the accuracy asked for was
    played_s, planned_s : duration, and that of the whole plan
    """

    network: LocalModelNetwork
    rounds: tuple[Round, ...]
    reached: bool
    played_s: float
    planned_s: float

    @property
    def saved_h(self) -> float:
        """Hours that the stop has saved."""
        return max(0.0, self.planned_s - self.played_s) / 3600.0


def sequential_design(
    experiment: Experiment,
    request: DesignRequest,
    target_std: float,
    play: Play,
    refit: Refit,
    progress: Progress | None = None,
) -> SequentialResult:
    """Play a sequence block by block.

    Parameters
    ----------
    experiment : first reference model, where the cell stands, and what is known already
    request : of the whole test; its `soc_levels` are visited down and up until the accuracy is reached
    target_std : largest standard deviation of a parameter that is asked for, normalised units; looked at once every
        level has been visited
    play : plays currents
    refit : fits to everything that was played; its network may have other parameters than the one before
    progress : called with a share 0..1 and a short text

    Returns
    -------
    SequentialResult

    Raises
    ------
    ModelError
        No levels, or an accuracy that is not positive.
    InfeasibleError
        Not even the first reference model keeps the limits.
    """
    _check(request, target_std)
    report = progress or (lambda share, text: None)
    plan = replace(plan_of(experiment, request), repeat=False)
    planned_s, builder = estimated_duration_s(plan), begin(plan)
    series, starts, rounds = list[TimeSeries](), list[float](), list[Round]()
    played, soc, proven = 0, plan.initial_soc, experiment
    for number in range(len(plan.visits())):
        builder, proven = _next_visit(builder, plan, number, (experiment, proven), request, rounds)
        piece = builder.current_A()[played:]
        report(number / len(plan.visits()), f"visit {number + 1} of {len(plan.visits())}")
        series.append(play(piece, soc))
        starts.append(soc)
        experiment = _with(experiment, refit(series, starts))
        rounds.append(_played(experiment, rounds, soc, piece))
        played, soc = played + len(piece), builder.soc
        # Not before every level has been visited: a network knows nothing of where it has not been.
        if number + 1 >= len(plan.soc_levels) and rounds[-1].largest_std <= target_std:
            break
    report(1.0, "done")
    reached = rounds[-1].largest_std <= target_std
    return SequentialResult(experiment.network, tuple(rounds), reached, played * plan.dt_s, planned_s)


def _check(request: DesignRequest, target_std: float) -> None:
    if not request.soc_levels:
        raise ModelError("a sequential design visits soc_levels; at least one is needed")
    if not (np.isfinite(target_std) and target_std > 0.0):
        raise ModelError(f"accuracy: the asked standard deviation is {target_std:g}; it must be positive")


def _next_visit(
    builder: SequenceBuilder,
    plan: SequencePlan,
    number: int,
    experiments: tuple[Experiment, Experiment],
    request: DesignRequest,
    rounds: list[Round],
) -> tuple[SequenceBuilder, Experiment]:
    """One more visit, and the experiment that it was designed with: the present one, else the last that could."""
    present, proven = experiments
    try:
        return _visited(builder, plan, number, present, request, rounds), present
    except InfeasibleError:
        # A network that has seen one level only knows too little of the voltage at the next to go there.
        return _visited(builder, plan, number, proven, request, rounds), proven


def _played(experiment: Experiment, rounds: list[Round], soc: float, current_A: FloatArray) -> Round:
    """One more round, with how well the parameters are known after it."""
    trial = Round(soc, current_A, np.nan, np.nan)
    std = parameter_std(_known(experiment, [*rounds, trial]))
    return replace(trial, largest_std=float(std.max()), mean_std=float(np.exp(np.log(std).mean())))


def _visited(
    builder: SequenceBuilder,
    plan: SequencePlan,
    number: int,
    experiment: Experiment,
    request: DesignRequest,
    rounds: list[Round],
) -> SequenceBuilder:
    """One more visit, designed with an experiment's network; what was there before stays as it is."""
    longer, optima = deepcopy(builder), list[Optimum]()
    visit(longer, plan, number, block_designer(experiment, request, plan, [_known(experiment, rounds)], optima))
    return longer


def _with(experiment: Experiment, network: LocalModelNetwork) -> Experiment:
    """Go on with another network; what was known of other parameters does not carry over."""
    same = network.theta.shape == experiment.network.theta.shape
    level_V = experiment.level_V if same else None
    return replace(experiment, network=network, prior=experiment.prior if same else None, level_V=level_V)


def _known(experiment: Experiment, rounds: list[Round]) -> FloatArray:
    """(M p, M p) information of all rounds at the present model."""
    total = experiment.prior_information()
    for each in rounds:
        here = replace(experiment, initial_soc=each.soc, prior=total)
        total = told_information(here, each.current_A)
    return total
