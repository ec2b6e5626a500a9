"""A request carried out: which reference model, which way of designing, and the answer of the public contract."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from models.data.timeseries import FloatArray, TimeSeries
from models.design.constraints.feasible import Feasible
from models.design.constraints.limits import InfeasibleError
from models.design.coverage import coverage_of
from models.design.design import Design, design, judged
from models.design.information.experiment import Experiment
from models.design.information.rival_experiment import RivalEvaluator
from models.design.optimise.ascent import Progress, optimise
from models.design.optimise.block_design import DesignRequest, demands_of
from models.design.optimise.reference_model import experiment_with, first_reference, pre_test
from models.design.request import DISCRIMINATE, RequestError, WrittenRequest
from models.design.rivals import rival_models
from models.design.sequence.profile import Profile
from models.network.local_model_network import LocalModelNetwork

_DEFAULT_DT_S, _DEFAULT_SOC = 1.0, 0.5
# Between a request's capacity and its model's: more is another cell, or a wrong unit.
_CAPACITY_TOLERANCE = 0.05
_SHORTEST_CYCLE_STEP_S = 0.01
_RIVAL_STARTS = 20


@dataclass(frozen=True)
class Material:
    """What a request names, read from wherever it lies.

    Attributes
    ----------
    network : the reference model, or None
    runs : measurements that a first reference model is fitted to, where there is no network
    runs_soc : state of charge at the start of each; empty: the first reference value of each
    cycle_A, cycle_dt_s : recorded load cycle on an even grid
    rivals : two models, or names of effects to be put into `network`, that the test is to tell apart
    """

    network: LocalModelNetwork | None = None
    runs: tuple[TimeSeries, ...] = ()
    runs_soc: tuple[float, ...] = ()
    cycle_A: FloatArray | None = None
    cycle_dt_s: float = _DEFAULT_DT_S
    rivals: tuple[LocalModelNetwork | str, ...] = ()


@dataclass(frozen=True)
class Answer:
    """A profile and what is to be said of it.

    Attributes
    ----------
    profile : for the bench
    figures : the `design` object of the public contract but for the profile's name, and more: plain types
    design : None for a pre-test
    asked : reference model and request that the design was made of; None where two models were to be told apart
    """

    profile: Profile
    figures: dict[str, Any]
    design: Design | None = None
    asked: tuple[Experiment, DesignRequest] | None = None


def answer(request: WrittenRequest, material: Material, progress: Progress | None = None) -> Answer:
    """Carry a request out.

    Parameters
    ----------
    request : as it was written
    material : what it names
    progress : called with a share 0..1 and a short text

    Returns
    -------
    Answer
        Without model and runs: a bounded pre-test, after which the request can be made again with its run.

    Raises
    ------
    InfeasibleError, RequestError, ModelError
        What stands against the request.
    """
    began = time.perf_counter()
    soc = _DEFAULT_SOC if request.initial_soc is None else request.initial_soc
    if request.criterion == DISCRIMINATE:
        return _discriminating(request, material, soc, began, progress)
    network = material.network
    if network is None and material.runs:
        if request.capacity_Ah is None:
            raise RequestError("capacity_Ah is missing; without a model it is needed to count charge, in Ah")
        network = first_reference(
            list(material.runs), request.capacity_Ah, request.dt_s, list(material.runs_soc) or None
        )
    if network is None:
        return _first_day(request, soc, began)
    _check_model(request, network)
    experiment = experiment_with(network, soc)
    asked = DesignRequest(
        limits=request.limits,
        duration_s=request.duration_s,
        criterion=request.criterion,
        signal=request.signal,
        soc_levels=request.soc_levels,
        rest_ratio=request.rest_ratio,
        final_rest_s=request.final_rest_s,
        target_std=request.target_std,
        cycle_A=_on_grid(material, network.structure.dt_s),
        seed=request.seed,
    )
    found = design(experiment, asked, progress)
    found = replace(found, seconds=time.perf_counter() - began)
    said = figures(found, network) | _accuracy(found, asked.target_std)
    return Answer(found.profile(), said, found, (experiment, asked))


def even_cycle(time_s: FloatArray, current_A: FloatArray) -> tuple[FloatArray, float]:
    """Put a current that holds forward onto an even grid of its shortest step; returns currents and step in s."""
    dt_s = max(float(np.diff(time_s).min()), _SHORTEST_CYCLE_STEP_S)
    at_s = (np.arange(int(time_s[-1] / dt_s + 1e-9)) + 1e-6) * dt_s
    index = np.searchsorted(time_s, at_s, side="right") - 1
    return current_A[np.clip(index, 0, len(current_A) - 1)], dt_s


def figures(found: Design, network: LocalModelNetwork) -> dict[str, Any]:
    """Figures of a design as plain types, with how far its reference model can be used."""
    optima = found.optima
    return {
        "duration_s": found.duration_s,
        "n_samples": len(found.current_A),
        "log_det_information": found.log_det,
        "parameter_std": found.parameter_std,
        "constraints_active_share": float(found.touched.mean()),
        "seconds": round(found.seconds, 3),
        "pre_test": False,
        "criterion_value": found.value,
        "net_charge_Ah": float(found.current_A.sum()) * found.dt_s / 3600.0,
        "throughput_Ah": float(np.abs(found.current_A).sum()) * found.dt_s / 3600.0,
        "predicted": {
            "voltage_V": [float(found.voltage_V.min()), float(found.voltage_V.max())],
            "voltage_with_band_V": [float(found.band_low_V.min()), float(found.band_high_V.max())],
            "soc": [float(found.soc.min()), float(found.soc.max())],
        },
        "blocks": [
            {"from_s": b.first * found.dt_s, "to_s": b.last * found.dt_s, "soc": b.soc, "repeats": b.repeats}
            for b in found.blocks
        ],
        "optimality": max((o.optimality for o in optima), default=None),
        "local_optima_spread": max((o.spread for o in optima), default=None),
        "coverage": found.coverage.to_json(),
        "usability": network.record.usability,
    }


def _accuracy(found: Design, target_std: float | None) -> dict[str, Any]:
    """What came of an accuracy that was asked for, and the hours it saves against the whole plan."""
    if target_std is None:
        return {}
    return {
        "accuracy": {
            "target_std": target_std,
            "largest_std": found.largest_std,
            "reached": found.largest_std <= target_std,
            "visits": len(found.blocks),
            "planned_s": found.planned_s,
            "saved_h": found.saved_h,
        }
    }


def _discriminating(
    request: WrittenRequest, material: Material, soc: float, began: float, progress: Progress | None
) -> Answer:
    report = progress or (lambda share, text: None)
    networks = rival_models(
        material.rivals,
        material.network,
        material.runs,
        material.runs_soc,
        lambda share, text: report(0.5 * share, text),
    )
    for network in networks:
        _check_model(request, network)
    first, second = (experiment_with(network, soc, coarse=False) for network in networks)
    n_samples = round(request.duration_s / first.network.structure.dt_s)
    demands = demands_of(first, request.limits)
    feasible = Feasible(first, demands, n_samples)
    objective = RivalEvaluator(first, second, n_samples)
    optimum = optimise(
        first,
        demands,
        n_samples,
        criterion=objective,
        n_starts=_RIVAL_STARTS,
        seed=request.seed,
        progress=lambda share, text: report(0.5 + 0.5 * share, text),
    )
    found = judged(first, "D", feasible, optimum.current_A, optima=(optimum,), seconds=time.perf_counter() - began)
    separation = [float(np.sqrt(part)) for part in objective.separation(optimum.current_A)]
    more = {"criterion_value": optimum.value, "separation": separation}
    return Answer(found.profile(), figures(found, networks[0]) | more, found)


def _first_day(request: WrittenRequest, soc: float, began: float) -> Answer:
    if request.capacity_Ah is None:
        raise RequestError("capacity_Ah is missing; without a model it is needed to bound the pre-test, in Ah")
    dt_s = request.dt_s or _DEFAULT_DT_S
    if not request.duration_s >= dt_s:
        raise InfeasibleError(f"duration is {request.duration_s:g} s: it holds no sample of {dt_s:g} s")
    profile = pre_test(request.limits, request.capacity_Ah, soc, request.duration_s, dt_s, request.seed)
    moved_As = profile.current_A[:-1] * np.diff(profile.time_s)
    path = profile.soc(soc, request.capacity_Ah)
    return Answer(
        profile,
        {
            "duration_s": profile.duration_s,
            "n_samples": round(profile.duration_s / dt_s),
            "log_det_information": None,
            "parameter_std": {},
            "constraints_active_share": 0.0,
            "seconds": round(time.perf_counter() - began, 3),
            "pre_test": True,
            "net_charge_Ah": float(moved_As.sum()) / 3600.0,
            "throughput_Ah": float(np.abs(moved_As).sum()) / 3600.0,
            "predicted": {"voltage_V": None, "soc": [float(path.min()), float(path.max())]},
            "coverage": _first_coverage(request, profile, soc, dt_s),
            "usability": None,
        },
    )


def _first_coverage(request: WrittenRequest, profile: Profile, soc: float, dt_s: float) -> dict[str, Any]:
    assert request.capacity_Ah is not None  # checked by its caller
    count = round(profile.duration_s / dt_s)
    index = np.searchsorted(profile.time_s, (np.arange(count) + 1e-6) * dt_s, side="right") - 1
    current = profile.current_A[index]
    path = soc + np.cumsum(current) * dt_s / (3600.0 * request.capacity_Ah)
    return coverage_of(request.limits, path, current, dt_s).to_json()


def _check_model(request: WrittenRequest, network: LocalModelNetwork) -> None:
    dt_s, capacity_Ah = network.structure.dt_s, network.cell.capacity_Ah
    if request.dt_s is not None and abs(request.dt_s - dt_s) > 1e-9 * dt_s:
        raise RequestError(f"dt_s is {request.dt_s:g} s, but the model's sampling time is {dt_s:g} s: leave dt_s out")
    if request.capacity_Ah is not None and abs(request.capacity_Ah / capacity_Ah - 1.0) > _CAPACITY_TOLERANCE:
        raise RequestError(
            f"capacity_Ah is {request.capacity_Ah:g} Ah, but the model was made for {capacity_Ah:g} Ah: another cell?"
        )


def _on_grid(material: Material, dt_s: float) -> FloatArray | None:
    """Load cycle at another sampling time, charge kept."""
    if material.cycle_A is None or len(material.cycle_A) == 0:
        return None
    charge = np.concatenate([[0.0], np.cumsum(material.cycle_A) * material.cycle_dt_s])
    time_s = material.cycle_dt_s * np.arange(len(charge))
    grid_s = dt_s * np.arange(int(time_s[-1] / dt_s + 1e-9) + 1)
    return np.diff(np.interp(grid_s, time_s, charge)) / dt_s if len(grid_s) > 2 else None
