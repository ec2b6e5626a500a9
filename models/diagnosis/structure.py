"""Structure mode: what is asked is which effect the model's structure lacks.

The network's error on all runs is explained by the sensitivities to the parameters that it has, by an open-circuit
curve as fine as held-out blocks ask for, and by one effect at a time. Without the sensitivities parameter errors would
be taken for effects; without the finer curve, its corners would.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.diagnosis.candidates import Candidate, Comparison, lean_columns, try_effect, try_lean
from models.diagnosis.evidence import Evidence
from models.diagnosis.memory import noise_mse
from models.diagnosis.ranking import Ranking, rank
from models.diagnosis.reference import Reference
from models.diagnosis.samples import Samples, all_samples, visible
from models.diagnosis.sensitivities import sensitivities_V
from models.effects import Effect
from models.effects.spline import SplineBasis
from models.local_model_network import LocalModelNetwork
from models.resampling import GridRun
from models.timeseries import FloatArray

_SAMPLES = 12_000
_RESOLUTIONS = (0, 10, 20, 40)
_RIDGES = (1e-7, 1e-5, 1e-3)
# A finer curve must lower the held-out error by this share.
_WORTH = 0.01
_HELD_OUT_RIDGE = 1e-5
# Here the own error is what all effects together leave of the same runs: no other record is held against it.
_BIAS_ALLOWANCE = 0.2
_NEARLY = 0.9


@dataclass(frozen=True)
class StructureAnalysis:
    """Everything that structure mode found.

    Attributes
    ----------
    comparison : all runs with the network's error and every effect's regressors
    ranking : of single effects
    second : ranking of further effects beside the named one; None where nothing was named
    n_train : samples of the training runs, the first ones
    resolution : bumps of the open-circuit curve that the data ask for beside the network's; 0: none
    """

    comparison: Comparison
    ranking: Ranking
    second: Ranking | None
    n_train: int
    resolution: int


def analyse_structure(
    network: LocalModelNetwork,
    reference: Reference,
    train: list[GridRun],
    train_soc: list[float],
    runs: list[GridRun],
    soc: list[float],
    effects: list[Effect],
) -> StructureAnalysis:
    """Try every effect beside what the network has.

    Parameters
    ----------
    network : the model
    reference : fitted to the same training runs; effects that scale the overvoltage take its resistances
    train, train_soc : what the network was fitted to; empty where it is not at hand
    runs, soc : runs to be explained
    effects : to be tried
    """
    samples = all_samples(reference, [*train, *runs], [*train_soc, *soc], _SAMPLES)
    error = np.concatenate([_error_V(network, view.run, view.initial_soc, view.index) for view in samples.views])
    own = np.vstack([sensitivities_V(network, view.run, view.initial_soc, view.index) for view in samples.views])
    evidence, resolution = _resolved(samples, error, own)
    usable = [effect for effect in effects if not effect.absorbed and visible(effect, [*train, *runs])]
    columns = {effect.name: samples.regressors(effect) for effect in usable}
    everything = evidence.solve(np.hstack(list(columns.values()))).cost / len(error)
    noise = min(noise_mse(samples), everything)
    comparison = Comparison(samples, tuple(usable), columns, evidence, everything, noise, _BIAS_ALLOWANCE)
    candidates = [try_effect(comparison, effect) for effect in usable]
    ranking = rank(comparison, candidates)
    second = _beside(comparison, ranking, usable) if ranking.significant else None
    n_train = sum(len(view.index) for view in samples.views[: len(train)])
    return StructureAnalysis(comparison, ranking, second, n_train, resolution)


def _error_V(network: LocalModelNetwork, run: GridRun, initial_soc: float, index: np.ndarray) -> FloatArray:
    return run.voltage_V[index] - network.free_run_V(run, initial_soc)[index]


def _resolved(samples: Samples, error: FloatArray, own: FloatArray) -> tuple[Evidence, int]:
    """Raise the resolution of the open-circuit curve until the held-out error stops falling."""
    soc = np.concatenate([view.soc[view.index] for view in samples.views])
    best: tuple[float, Evidence, int] | None = None
    for size in _RESOLUTIONS:
        curve = SplineBasis(float(soc.min()), float(soc.max()), size).matrix(soc) if size else np.zeros((len(soc), 0))
        regressors = np.hstack([own, curve])
        scale = (regressors**2).sum(axis=0) + 1e-12
        tried = [Evidence(error, regressors, np.diag(ridge * scale), samples.blocks) for ridge in _RIDGES]
        losses = [float((each.null_errors_V**2).sum()) for each in tried]
        loss = min(losses)
        if best is not None and loss > (1.0 - _WORTH) * best[0]:
            break
        best = (loss, tried[losses.index(loss)], size)
    assert best is not None
    return best[1], best[2]


def _beside(comparison: Comparison, ranking: Ranking, effects: list[Effect]) -> Ranking | None:
    """Rank the other effects once the named one is in the model."""
    named = ranking.candidates[0]
    left = [effect for effect in effects if effect.name != named.effect.name]
    if not left:
        return None
    evidence = comparison.evidence
    wider = np.hstack([evidence.regressors, named.columns])
    information = np.zeros((wider.shape[1],) * 2)
    p = evidence.regressors.shape[1]
    information[:p, :p] = evidence.information
    added = np.arange(p, len(information))
    information[added, added] = 1e-6 * (named.columns**2).sum(axis=0) + 1e-12
    beside = Comparison(
        comparison.runs,
        comparison.effects,
        comparison.columns,
        Evidence(named.target_V, wider, information, evidence.blocks),
        comparison.own_mse,
        comparison.noise_mse,
        _BIAS_ALLOWANCE,
    )
    return rank(beside, [try_effect(beside, effect) for effect in left])


def held_out_mse(analysis: StructureAnalysis, candidate: Candidate | None = None) -> float:
    """Mean squared error of the diagnosed runs when network and effect are refitted to the training runs, V^2.

    The effect enters in its smallest form where it has one and that explains nearly as much. Without training runs it
    is the error in held-out blocks.

    Parameters
    ----------
    analysis : of the runs
    candidate : the effect; None: the network alone
    """
    comparison, n = analysis.comparison, analysis.n_train
    evidence = comparison.evidence
    x, y = np.zeros((len(evidence.error_V), 0)), evidence.error_V
    if candidate is not None:
        x, y = _form(comparison, candidate), candidate.target_V
    if n == 0:
        gained = evidence.gains(x, y).sum() if candidate is not None else 0.0
        return float(((evidence.null_errors_V**2).sum() - gained) / len(y))
    whole = np.hstack([evidence.regressors, x])
    p = evidence.regressors.shape[1]
    # What the training runs do not show stays where it was instead of running away in the others.
    ridge = _HELD_OUT_RIDGE * (whole**2).sum(axis=0) + 1e-12
    information = whole[:n].T @ whole[:n] + np.diag(ridge)
    information[:p, :p] += evidence.information
    scale = np.sqrt(np.diag(information))
    b = np.linalg.solve(information / np.outer(scale, scale), whole[:n].T @ y[:n] / scale) / scale
    return float(np.mean((y[n:] - whole[n:] @ b) ** 2))


def _form(comparison: Comparison, candidate: Candidate) -> FloatArray:
    """(n, k) regressors of an effect: of its smallest form where that will do."""
    lean = candidate.effect.lean
    if lean is None:
        return candidate.columns
    small = try_lean(comparison, candidate.effect)
    gained = comparison.evidence.cost - candidate.solution.cost
    if comparison.evidence.cost - small.cost < _NEARLY * gained:
        return candidate.columns
    return lean_columns(comparison, lean, small.shape)[:, : small.columns]
