"""Blocks of a sequence: each one the most informative current around its level for what is not known yet."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from models.data.timeseries import FloatArray
from models.design.constraints.feasible import Demands
from models.design.constraints.limitation import LimitationRatio, default_ratio, limitation_ratio
from models.design.constraints.limits import CurrentBounds, InfeasibleError, Limits, Window
from models.design.constraints.voltage_band import colder_words, recorded_band
from models.design.information.experiment import Evaluator, Experiment
from models.design.optimise.ascent import Objective, Optimum, optimise
from models.design.optimise.reference_model import predicted_temperature
from models.design.optimise.robust import robust_criterion
from models.design.sequence.excitation_sequence import BlockDesigner, fitted_to
from models.design.sequence.load_cycle import amplitude_bounds, load_cycle_bounds, load_histogram, mean_current_range
from models.design.sequence.sequence_builder import LEAST_SHARE
from models.design.sequence.sequence_plan import SequencePlan
from models.network.local_model_network import LocalModelNetwork

OPTIMAL = "optimal"
_BLOCK_STARTS = 10
# Of the longest time constant of the network, where it is shorter than what pulses are to show.
_LEAST_LONGEST_S = 50.0
# How long the largest current is taken to be held where the voltage limits it.
_LIMITATION_S = 300.0
# Left to the window's ends, relative to its width: sums of charge are rounded.
_EDGE = 1e-6
# The window of the state of charge where none is given.
_NO_WINDOW = (0.0, 1.0)
# Levels that had to be moved are kept if they lie further from the others than this share of the levels' spacing.
_CLOSEST = 0.25
# Of the range of the mean current that the intervals of a load cycle leave.
_RANGE_SHARE = 0.7
# Rest at the end of a sequence, of its time and at most; its pulses have rests of their own.
_FINAL_REST_SHARE, _FINAL_REST_S = 0.06, 1800.0
# Rest at each end of the window, of the time: what the cell's temperature and its history do at the start is else told
# by nothing.
_END_REST_SHARE = 0.03
# Of the largest mean current that a block could have.
_CARRIED = 0.8
# How far a block may leave the way that it carries the charge along. Wider loops would undo the branch of hysteresis
# that the sequence is on, and on such branches a cell is used.
_BESIDE_SOC, _LEVEL_S = 0.015, 30.0
# Currents of every second block, of the others'. A cell that is under the same load all along is as warm all along, and
# what the warmth does cannot be told from what else comes with it. Of two levels two blocks in three would be gentle.
_GENTLE, _GENTLE_LEVELS = 0.5, 3


@dataclass(frozen=True)
class DesignRequest:
    """What a test shall be.

    Attributes
    ----------
    limits : that it keeps
    duration_s : of the whole test
    criterion : "A", "D" or "E"
    signal : "optimal", or the name of a family
    soc_levels : states of charge at which optimised blocks are played, pulses and rests around them; none: one block
    rest_ratio : rest over pulse
    final_rest_s : rest at the end, part of the duration: slow relaxation shows nowhere else, and the next run begins
        with a cell that has forgotten this one; by default 6 % of a sequence, at most half an hour, and none of
        anything else
    cycle_A : (n,) recorded load cycle at the network's sampling time: its histogram bounds the blocks' currents
    amplitude_levels : shares of the largest current between which the blocks of a sequence change, where there is no
        load cycle. What is D-optimal for a model that is linear in the current uses the largest currents only, and a
        cell is not linear: the model would be wrong at all others.
    target_std : a sequence ends after the visit at which every parameter is expected to be known as well as this
        (standard deviation, normalised units), once all levels have been visited; None: it takes the whole duration
    n_starts : of each optimisation; by default 40 of one block, 10 of each of several
    seed : of everything that is drawn
    """

    limits: Limits
    duration_s: float
    criterion: str = "D"
    signal: str = OPTIMAL
    soc_levels: tuple[float, ...] = ()
    rest_ratio: float = 8.0
    final_rest_s: float | None = None
    cycle_A: FloatArray | None = None
    amplitude_levels: tuple[float, ...] = (0.8, 0.5, 0.25, 0.12, 0.05)
    target_std: float | None = None
    n_starts: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the rest."""
        if self.final_rest_s and not 0.0 <= self.final_rest_s <= 0.5 * self.duration_s:
            raise InfeasibleError(
                f"final_rest_s is {self.final_rest_s:g} s; it must lie between 0 and half the duration of "
                f"{self.duration_s:g} s"
            )
        if self.target_std is None:
            return
        if not (np.isfinite(self.target_std) and self.target_std > 0.0):
            raise InfeasibleError(f"target_std is {self.target_std:g}; a standard deviation must be positive")
        if not self.soc_levels:
            raise InfeasibleError("target_std is given without soc_levels: only a sequence of visits can end early")

    @property
    def rest_s(self) -> float:
        """Rest at the end."""
        if self.final_rest_s is not None:
            return self.final_rest_s
        is_sequence = self.signal == OPTIMAL and bool(self.soc_levels)
        return min(_FINAL_REST_S, _FINAL_REST_SHARE * self.duration_s) if is_sequence else 0.0

    @property
    def active_s(self) -> float:
        """Duration without the rest at the end."""
        return self.duration_s - self.rest_s


def demands_of(experiment: Experiment, limits: Limits, bounds: CurrentBounds | None = None) -> Demands:
    """Limits with what predicts voltage and temperature.

    Raises
    ------
    InfeasibleError
        The temperature is limited, but the network has no thermal model.
    """
    experiment, temperature_of = experiment.predicted, None
    if limits.temperature_degC is not None:
        temperature_of = predicted_temperature(experiment.network, experiment.initial_soc, experiment.temperature_degC)
        if temperature_of is None:
            raise InfeasibleError(
                "limit temperature_degC is given, but the model has no thermal model to predict it: fit it to runs "
                "with ambient_degC, or leave the limit to the bench"
            )
    return Demands(limits, bounds, recorded_band(experiment.network), temperature_of)


def longest_time_constant_s(network: LocalModelNetwork) -> float:
    """Longest time constant of the local models and of the filters of their inputs."""
    dt_s, order = network.structure.dt_s, network.structure.output_order
    found = [_LEAST_LONGEST_S]
    if order:
        companion = np.zeros((network.n_models, order, order))
        companion[:, 0] = network.theta[:, :order]
        companion[:, 1:, :-1] += np.eye(order - 1)
        poles = np.abs(np.linalg.eigvals(companion))
        found += [-dt_s / float(np.log(pole)) for pole in poles.ravel() if 0.0 < pole < 1.0]
    return max(found)


def cycle_bounds(experiment: Experiment, request: DesignRequest, n_samples: int, number: int) -> CurrentBounds | None:
    """Limits of a block's current from the load cycle, where there is one; another order for each block."""
    if request.cycle_A is None:
        return None
    limits, dt_s = request.limits, experiment.network.structure.dt_s
    rng = np.random.default_rng([request.seed, number])
    ratio = default_ratio(limits.soc) if limits.voltage_V is None else _ratio(experiment, request)
    return load_cycle_bounds(load_histogram(request.cycle_A), n_samples, dt_s, limits.current_A, ratio, rng)


def plan_of(experiment: Experiment, request: DesignRequest) -> SequencePlan:
    """Plan of a sequence whose blocks fill the time asked for."""
    network, ratio = experiment.network, _ratio(experiment, request)
    reached = ratio.reach(experiment.initial_soc, LEAST_SHARE)
    plan = SequencePlan(
        limits=request.limits,
        capacity_Ah=network.cell.capacity_Ah,
        initial_soc=experiment.initial_soc,
        dt_s=network.structure.dt_s,
        soc_levels=_within(request.soc_levels, reached),
        block_s=network.structure.dt_s,
        longest_s=longest_time_constant_s(network),
        ratio=ratio,
        rest_ratio=request.rest_ratio,
        ends=_ends(request, reached),
        end_rest_s=min(_END_REST_SHARE * request.active_s, _FINAL_REST_S),
        carry_share=_CARRIED * float(np.mean(request.amplitude_levels)),
        gentle_share=_GENTLE if request.cycle_A is None and len(request.soc_levels) >= _GENTLE_LEVELS else 1.0,
        mean_A=_mean_A(request),
    )
    try:
        return fitted_to(plan, request.active_s)
    except InfeasibleError as error:
        if request.limits.voltage_V is None:
            raise
        # Near its limits the voltage leaves so little current that the way takes long.
        raise InfeasibleError(f"{error}, a wider limit voltage_V{colder_words(experiment)}") from None


def _within(levels: tuple[float, ...], reached: Window) -> tuple[float, ...]:
    """Levels beyond what can be reached are moved to where that ends; those that would be all but the same are one."""
    spacing = min(np.diff(levels).tolist(), default=0.0)
    moved = np.clip(levels, min(reached[0], levels[-1]), max(reached[1], levels[0]))
    kept = [float(moved[0])]
    for level in moved[1:].tolist():
        if level - kept[-1] >= _CLOSEST * spacing:
            kept.append(level)
    return tuple(kept)


def _ends(request: DesignRequest, reached: Window) -> Window | None:
    """Ends of the window that was asked for, as far as they can be reached; a single level is no sequence over it."""
    low, high = request.limits.soc
    if len(request.soc_levels) < 2 or (low, high) == _NO_WINDOW:
        return None
    margin = _EDGE * (high - low)
    return max(low + margin, reached[0]), min(high - margin, reached[1])


def _mean_A(request: DesignRequest) -> Window | None:
    """Range of a block's mean current within the load cycle's histogram; its ends would leave nothing to design."""
    if request.cycle_A is None:
        return None
    low, high = mean_current_range(load_histogram(request.cycle_A), request.limits.current_A)
    middle, half = 0.5 * (low + high), 0.5 * _RANGE_SHARE * (high - low)
    return middle - half, middle + half


def _ratio(experiment: Experiment, request: DesignRequest) -> LimitationRatio:
    network = experiment.predicted.network
    band, longest_s = recorded_band(network), longest_time_constant_s(network)
    return limitation_ratio(experiment, request.limits, band, min(longest_s, _LIMITATION_S))


def block_designer(
    experiment: Experiment,
    request: DesignRequest,
    plan: SequencePlan,
    known: list[FloatArray],
    optima: list[Optimum],
) -> BlockDesigner:
    """Return a function that designs the block at a state of charge.

    Parameters
    ----------
    experiment, request, plan : what is to be learnt
    known : information so far; each block's is added to its first entry
    optima : each block's optimum is appended
    """
    n_samples = round(plan.block_s / plan.dt_s)
    half = min(0.5 * min(np.diff(plan.soc_levels).tolist(), default=2.0), _beside_soc(plan))
    low, high = request.limits.soc

    def bounds_of(here: Experiment, number: int) -> CurrentBounds:
        bounds = cycle_bounds(here, request, n_samples, number)
        if bounds is not None:
            return bounds
        rng = np.random.default_rng([request.seed, number])
        levels = tuple(plan.share_of(number) * level for level in request.amplitude_levels)
        return amplitude_bounds(levels, n_samples, plan.dt_s, request.limits.current_A, rng)

    def near(soc: float, change: float) -> Limits:
        # The block moves the charge as asked: the duration is the plan's.
        charge_Ah = change * plan.capacity_Ah
        window = (max(low, min(soc, soc + change) - half), min(high, max(soc, soc + change) + half))
        return replace(request.limits, soc=window, net_charge_Ah=(charge_Ah, charge_Ah), temperature_degC=None)

    def block(soc: float, number: int, change: float) -> FloatArray:
        here = replace(experiment, initial_soc=soc, prior=known[0])
        bounds, limits = bounds_of(here, number), near(soc, change)
        criterion: str | Objective = request.criterion
        if experiment.prior is not None:
            criterion = robust_criterion(here, n_samples, request.criterion, number)
        # Near the window's ends the voltage leaves less than it takes to carry the charge on, and the limitation ratio
        # less of a cycle's currents than its histogram has.
        free = replace(limits, soc=request.limits.soc, net_charge_Ah=None)
        found = _first_possible(
            (limits, near(soc, 0.0) if request.cycle_A is None else free, free),
            lambda kept: optimise(
                here,
                demands_of(here, kept, bounds),
                n_samples,
                criterion=criterion,
                n_starts=request.n_starts or _BLOCK_STARTS,
                seed=request.seed + 1000 * number,
            ),
        )
        optima.append(found)
        known[0] = Evaluator(here, n_samples).information(found.current_A)
        return found.current_A

    return block


def _first_possible(tries: tuple[Limits, ...], design: Callable[[Limits], Optimum]) -> Optimum:
    """What can be designed within the first of some limits that leave a way; the last ones' refusal counts."""
    for limits in tries[:-1]:
        with contextlib.suppress(InfeasibleError):
            return design(limits)
    return design(tries[-1])


def _beside_soc(plan: SequencePlan) -> float:
    """Room of a block beside its way: at the least for half a minute of the largest current."""
    low_A, high_A = plan.limits.current_A
    return max(_BESIDE_SOC, max(-low_A, high_A) * _LEVEL_S / 3600.0 / plan.capacity_Ah)
