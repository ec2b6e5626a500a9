"""From what is asked to a test that is ready to be played, with what it will tell."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.design.constraints.feasible import Feasible
from models.design.constraints.limits import InfeasibleError, Limits, Window, soc_path
from models.design.constraints.voltage_band import colder_words
from models.design.coverage import Coverage, coverage_of
from models.design.information.coloured import told_information
from models.design.information.criteria import CRITERIA
from models.design.information.experiment import Evaluator, Experiment
from models.design.information.parameters import parameter_names, parameter_std
from models.design.optimise.ascent import Optimum, Progress, optimise
from models.design.optimise.block_design import (
    OPTIMAL,
    DesignRequest,
    block_designer,
    cycle_bounds,
    demands_of,
    plan_of,
)
from models.design.optimise.reference_model import predicted_temperature
from models.design.optimise.robust import robust_criterion
from models.design.sequence.excitation_sequence import (
    Block,
    ExcitationSequence,
    build_sequence,
    compact_profile,
    estimated_duration_s,
)
from models.design.sequence.profile import Profile
from models.design.sequence.sequence_plan import SequencePlan
from models.design.test_signals import family
from models.design.test_signals.family import FamilyRequest

_SINGLE_STARTS = 40


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
    planned_s : duration of the whole plan; a test ends before it where the accuracy asked for is reached
    coverage : how much of what was asked for it goes through
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
    planned_s: float
    coverage: Coverage

    @property
    def duration_s(self) -> float:
        """How long the test takes."""
        return len(self.current_A) * self.dt_s

    @property
    def saved_h(self) -> float:
        """Hours that the whole plan would have taken longer."""
        return max(self.planned_s - self.duration_s, 0.0) / 3600.0

    @property
    def largest_std(self) -> float:
        """Of the parameters, normalised units."""
        return max(self.parameter_std.values())

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
    n_samples = round(request.active_s / dt_s) if np.isfinite(request.duration_s) else 0
    if n_samples < 1:
        raise InfeasibleError(f"duration is {request.duration_s:g} s: it holds no sample of {dt_s:g} s")
    blocks: tuple[Block, ...] = ()
    optima: tuple[Optimum, ...] = ()
    plan: SequencePlan | None = None
    if request.signal != OPTIMAL:
        raw = _family_A(experiment, request)
    elif request.soc_levels:
        sequence, optima, plan = _sequence(experiment, request, report)
        raw, blocks = sequence.current_A, sequence.blocks
    else:
        optimum = _single(experiment, request, n_samples, report)
        raw, optima = optimum.current_A, (optimum,)
    raw = np.append(raw, np.zeros(round(request.rest_s / dt_s)))
    feasible = Feasible(experiment, demands_of(experiment, request.limits), len(raw))
    current = feasible.finish(raw)
    report(1.0, "done")
    seconds = time.perf_counter() - began
    planned_s = None if plan is None else estimated_duration_s(plan) + request.rest_s
    meant = None if request.limits.voltage_V is None else _meant_soc(experiment, request.limits, raw)
    return judged(experiment, request.criterion, feasible, current, blocks, optima, seconds, planned_s, plan, meant)


def judged(
    experiment: Experiment,
    criterion: str,
    feasible: Feasible,
    current_A: FloatArray,
    blocks: tuple[Block, ...] = (),
    optima: tuple[Optimum, ...] = (),
    seconds: float = 0.0,
    planned_s: float | None = None,
    plan: SequencePlan | None = None,
    meant_soc: Window | None = None,
) -> Design:
    """Say what a current would tell."""
    information = told_information(experiment, current_A)
    std = dict(zip(parameter_names(experiment.network), parameter_std(information).tolist(), strict=True))
    predicted = Evaluator(experiment.predicted, len(current_A)).predict(current_A)
    (low, high), dt_s = feasible.voltage_band_V(current_A), experiment.network.structure.dt_s
    return Design(
        current_A=current_A,
        dt_s=dt_s,
        value=CRITERIA[criterion](information)[0],
        log_det=CRITERIA["D"](information)[0],
        information=information,
        parameter_std=std,
        voltage_V=predicted.voltage_V,
        band_low_V=low,
        band_high_V=high,
        soc=predicted.soc,
        touched=feasible.touched(current_A),
        blocks=blocks,
        optima=optima,
        seconds=seconds,
        planned_s=len(current_A) * dt_s if planned_s is None else planned_s,
        coverage=_coverage(experiment, feasible.limits, predicted.soc, current_A, plan, meant_soc),
    )


def _coverage(
    experiment: Experiment,
    limits: Limits,
    soc: FloatArray,
    current_A: FloatArray,
    plan: SequencePlan | None,
    meant_soc: Window | None,
) -> Coverage:
    predicted, dt_s = experiment.predicted, experiment.network.structure.dt_s
    temperature_of = predicted_temperature(predicted.network, predicted.initial_soc, predicted.temperature_degC, 0.0)
    degC = None if temperature_of is None else temperature_of(current_A)
    return coverage_of(limits, soc, current_A, dt_s, plan, degC, meant_soc, colder_words(experiment))


def _meant_soc(experiment: Experiment, limits: Limits, current_A: FloatArray) -> Window:
    """How far a current goes inside the window of the state of charge, before the voltage is looked at."""
    cell = experiment.network.cell
    per_A = experiment.network.structure.dt_s / 3600.0 / cell.capacity_Ah
    soc = np.clip(soc_path(current_A, experiment.initial_soc, per_A, cell.efficiency), *limits.soc)
    return float(soc.min()), float(soc.max())


def _single(experiment: Experiment, request: DesignRequest, n_samples: int, report: Progress) -> Optimum:
    return optimise(
        experiment,
        demands_of(experiment, request.limits, cycle_bounds(experiment, request, n_samples, 0)),
        n_samples,
        criterion=robust_criterion(experiment, n_samples, request.criterion, request.seed),
        n_starts=request.n_starts or _SINGLE_STARTS,
        seed=request.seed,
        progress=report,
    )


def _family_A(experiment: Experiment, request: DesignRequest) -> FloatArray:
    asked = FamilyRequest(
        current_A=request.limits.current_A,
        soc=request.limits.soc,
        capacity_Ah=experiment.network.cell.capacity_Ah,
        initial_soc=experiment.initial_soc,
        duration_s=request.active_s,
        dt_s=experiment.network.structure.dt_s,
        cycle_A=request.cycle_A,
    )
    return family(request.signal).build(asked, np.random.default_rng(request.seed))


def _sequence(
    experiment: Experiment, request: DesignRequest, report: Progress
) -> tuple[ExcitationSequence, tuple[Optimum, ...], SequencePlan]:
    """Blocks one after the other, each designed for what those before it leave unknown; and their plan."""
    plan = plan_of(experiment, request)
    n_blocks, optima = len(plan.visits()), list[Optimum]()
    known = [experiment.prior_information()]
    designer = block_designer(experiment, request, plan, known, optima)

    def tell(soc: float, number: int, change: float) -> FloatArray:
        report(number / n_blocks, f"block {number + 1} of {n_blocks} at SoC {soc:.2f}")
        return designer(soc, number, change)

    def enough(current_A: FloatArray) -> bool:
        if request.target_std is None:
            return False
        information = told_information(experiment, current_A)
        return float(parameter_std(information).max()) <= request.target_std

    sequence = build_sequence(plan, tell, enough)
    return sequence, tuple(optima), plan
