"""From what is asked to a test that is ready to be played, with what it will tell."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from models.design.ascent import Optimum, Progress, optimise
from models.design.criteria import CRITERIA
from models.design.excitation_sequence import (
    Block,
    BlockDesigner,
    ExcitationSequence,
    SequencePlan,
    build_sequence,
    compact_profile,
    fitted_to,
)
from models.design.experiment import Evaluator, Experiment, parameter_names, parameter_std
from models.design.family import FamilyRequest, family
from models.design.feasible import Demands, Feasible
from models.design.limitation import LimitationRatio, default_ratio, limitation_ratio
from models.design.limits import CurrentBounds, InfeasibleError, Limits, soc_path
from models.design.load_cycle import amplitude_bounds, load_cycle_bounds, load_histogram
from models.design.profile import Profile
from models.design.reference_model import predicted_temperature
from models.design.voltage_band import recorded_band
from models.errors import ModelError
from models.local_model_network import LocalModelNetwork
from models.timeseries import FloatArray

OPTIMAL = "optimal"
_SINGLE_STARTS, _BLOCK_STARTS = 40, 10
# Of the longest time constant of the network, where it is shorter than what pulses are to show.
_LEAST_LONGEST_S = 50.0
# How long the largest current is taken to be held where the voltage limits it.
_LIMITATION_S = 300.0


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
    cycle_A : (n,) recorded load cycle at the network's sampling time: its histogram bounds the blocks' currents
    amplitude_levels : shares of the largest current between which the blocks of a sequence change, where there is no
        load cycle. What is D-optimal for a model that is linear in the current uses the largest currents only, and a
        cell is not linear: the model would be wrong at all others.
    n_starts : of each optimisation; by default 40 of one block, 10 of each of several
    seed : of everything that is drawn
    """

    limits: Limits
    duration_s: float
    criterion: str = "D"
    signal: str = OPTIMAL
    soc_levels: tuple[float, ...] = ()
    rest_ratio: float = 8.0
    cycle_A: FloatArray | None = None
    amplitude_levels: tuple[float, ...] = (1.0, 0.6, 0.25)
    n_starts: int | None = None
    seed: int = 0


@dataclass(frozen=True)
class Design:
    """A test, and what the reference model expects of it.

    Attributes
    ----------
    current_A : (N,) current_A[k] flows from k dt to (k + 1) dt
    dt_s : sampling time
    value : of the criterion after the test
    log_det : of the information after the test
    information : (M p, M p), prior included
    parameter_std : by the parameters' names, normalised units
    voltage_V, band_low_V, band_high_V, soc : (N,) predicted, at the end of each sample
    touched : (N,) whether a sample lies at one of its limits
    blocks : where the optimised currents lie
    optima : of each optimisation: how good it is, and the spread of the local optima
    seconds : that the design took
    """

    current_A: FloatArray
    dt_s: float
    value: float
    log_det: float
    information: FloatArray
    parameter_std: dict[str, float]
    voltage_V: FloatArray
    band_low_V: FloatArray
    band_high_V: FloatArray
    soc: FloatArray
    touched: np.ndarray
    blocks: tuple[Block, ...]
    optima: tuple[Optimum, ...]
    seconds: float

    @property
    def duration_s(self) -> float:
        """How long the test takes."""
        return len(self.current_A) * self.dt_s

    def profile(self) -> Profile:
        """Rows for a bench."""
        return compact_profile(self.current_A, self.dt_s)


def design(experiment: Experiment, request: DesignRequest, progress: Progress | None = None) -> Design:
    """Design a test.

    Parameters
    ----------
    experiment : reference model and where the cell stands
    request : what the test shall be
    progress : called with a share 0..1 and a short text

    Returns
    -------
    Design
        Its current keeps every limit as the model predicts it, the band of the voltage included.

    Raises
    ------
    InfeasibleError
        The request cannot be met; the message names what stands against it.
    """
    began = time.perf_counter()
    report = progress or (lambda share, text: None)
    if request.criterion not in CRITERIA:
        raise ModelError(f"criterion {request.criterion!r} is unknown; use one of {', '.join(CRITERIA)}")
    dt_s = experiment.network.structure.dt_s
    n_samples = round(request.duration_s / dt_s) if np.isfinite(request.duration_s) else 0
    if n_samples < 1:
        raise InfeasibleError(f"duration is {request.duration_s:g} s: it holds no sample of {dt_s:g} s")
    blocks: tuple[Block, ...] = ()
    optima: tuple[Optimum, ...] = ()
    if request.signal != OPTIMAL:
        raw = _family_A(experiment, request)
    elif request.soc_levels:
        sequence, optima = _sequence(experiment, request, report)
        raw, blocks = sequence.current_A, sequence.blocks
    else:
        optimum = _single(experiment, request, n_samples, report)
        raw, optima = optimum.current_A, (optimum,)
    feasible = Feasible(experiment, demands_of(experiment, request.limits), len(raw))
    current = feasible.finish(raw)
    report(1.0, "done")
    return judged(experiment, request.criterion, feasible, current, blocks, optima, time.perf_counter() - began)


def judged(
    experiment: Experiment,
    criterion: str,
    feasible: Feasible,
    current_A: FloatArray,
    blocks: tuple[Block, ...] = (),
    optima: tuple[Optimum, ...] = (),
    seconds: float = 0.0,
) -> Design:
    """Say what a current would tell."""
    evaluator = Evaluator(experiment, len(current_A), criterion)
    information = evaluator.information(current_A)
    std = parameter_std(information)
    predicted = evaluator.predict(current_A)
    low, high = feasible.voltage_band_V(current_A)
    return Design(
        current_A=current_A,
        dt_s=experiment.network.structure.dt_s,
        value=CRITERIA[criterion](information)[0],
        log_det=CRITERIA["D"](information)[0],
        information=information,
        parameter_std=dict(zip(parameter_names(experiment.network), std.tolist(), strict=True)),
        voltage_V=predicted.voltage_V,
        band_low_V=low,
        band_high_V=high,
        soc=predicted.soc,
        touched=feasible.touched(current_A),
        blocks=blocks,
        optima=optima,
        seconds=seconds,
    )


def demands_of(experiment: Experiment, limits: Limits, bounds: CurrentBounds | None = None) -> Demands:
    """Limits with what predicts voltage and temperature.

    Raises
    ------
    InfeasibleError
        The temperature is limited, but the network has no thermal model.
    """
    temperature_of = None
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


def _single(experiment: Experiment, request: DesignRequest, n_samples: int, report: Progress) -> Optimum:
    return optimise(
        experiment,
        demands_of(experiment, request.limits, _cycle_bounds(experiment, request, n_samples, 0)),
        n_samples,
        criterion=request.criterion,
        n_starts=request.n_starts or _SINGLE_STARTS,
        seed=request.seed,
        progress=report,
    )


def _cycle_bounds(experiment: Experiment, request: DesignRequest, n_samples: int, number: int) -> CurrentBounds | None:
    if request.cycle_A is None:
        return None
    limits, dt_s = request.limits, experiment.network.structure.dt_s
    rng = np.random.default_rng([request.seed, number])
    ratio = default_ratio(limits.soc) if limits.voltage_V is None else _ratio(experiment, request)
    return load_cycle_bounds(load_histogram(request.cycle_A), n_samples, dt_s, limits.current_A, ratio, rng)


def _family_A(experiment: Experiment, request: DesignRequest) -> FloatArray:
    asked = FamilyRequest(
        current_A=request.limits.current_A,
        soc=request.limits.soc,
        capacity_Ah=experiment.network.cell.capacity_Ah,
        initial_soc=experiment.initial_soc,
        duration_s=request.duration_s,
        dt_s=experiment.network.structure.dt_s,
        cycle_A=request.cycle_A,
    )
    return family(request.signal).build(asked, np.random.default_rng(request.seed))


def _sequence(
    experiment: Experiment, request: DesignRequest, report: Progress
) -> tuple[ExcitationSequence, tuple[Optimum, ...]]:
    """Blocks one after the other, each designed for what those before it leave unknown."""
    plan = plan_of(experiment, request)
    n_blocks, optima = len(plan.visits()), list[Optimum]()
    known = [experiment.prior_information()]
    designer = block_designer(experiment, request, plan, known, optima)

    def tell(soc: float, number: int, change: float) -> FloatArray:
        report(number / n_blocks, f"block {number + 1} of {n_blocks} at SoC {soc:.2f}")
        return designer(soc, number, change)

    return build_sequence(plan, tell), tuple(optima)


def plan_of(experiment: Experiment, request: DesignRequest) -> SequencePlan:
    """Plan of a sequence whose blocks fill the time asked for."""
    network = experiment.network
    plan = SequencePlan(
        limits=request.limits,
        capacity_Ah=network.cell.capacity_Ah,
        initial_soc=experiment.initial_soc,
        dt_s=network.structure.dt_s,
        soc_levels=request.soc_levels,
        block_s=network.structure.dt_s,
        longest_s=longest_time_constant_s(network),
        ratio=_ratio(experiment, request),
        rest_ratio=request.rest_ratio,
    )
    return fitted_to(plan, request.duration_s)


def _ratio(experiment: Experiment, request: DesignRequest) -> LimitationRatio:
    band, longest_s = recorded_band(experiment.network), longest_time_constant_s(experiment.network)
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
    half = 0.5 * float(np.min(np.diff(plan.soc_levels))) if len(plan.soc_levels) > 1 else 1.0
    low, high = request.limits.soc

    def block(soc: float, number: int, change: float) -> FloatArray:
        here = replace(experiment, initial_soc=soc, prior=known[0])
        bounds = _cycle_bounds(experiment, request, n_samples, number)
        if bounds is None:
            rng = np.random.default_rng([request.seed, number])
            bounds = amplitude_bounds(request.amplitude_levels, n_samples, plan.dt_s, request.limits.current_A, rng)
        # Where the current's bounds leave the charge free the block moves it as asked: the duration is the plan's.
        charge_Ah = change * plan.capacity_Ah
        net = (charge_Ah, charge_Ah) if request.cycle_A is None else None
        window = (max(low, min(soc, soc + change) - half), min(high, max(soc, soc + change) + half))
        near = replace(request.limits, soc=window, net_charge_Ah=net, temperature_degC=None)
        optimum = optimise(
            here,
            demands_of(here, near, bounds),
            n_samples,
            criterion=request.criterion,
            n_starts=request.n_starts or _BLOCK_STARTS,
            seed=request.seed + 1000 * number,
        )
        optima.append(optimum)
        known[0] = Evaluator(here, n_samples).information(optimum.current_A)
        return optimum.current_A

    return block


def predicted_soc(experiment: Experiment, current_A: FloatArray) -> FloatArray:
    """(N + 1,) state of charge before each sample and after the last."""
    network = experiment.network
    per_A = network.structure.dt_s / 3600.0 / network.cell.capacity_Ah
    return soc_path(current_A, experiment.initial_soc, per_A, network.cell.efficiency)
