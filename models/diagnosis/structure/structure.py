"""Structure mode: what is asked is which effect the model's structure lacks.

The network's error on all runs is explained by the sensitivities to the parameters that it has, by an open-circuit
curve as fine as held-out blocks ask for, and by one effect at a time. Without the sensitivities parameter errors would
be taken for effects; without the finer curve, its corners would.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.evidence.candidates import Candidate, Comparison, lean_columns, try_effect, try_lean
from models.diagnosis.evidence.joint import Named, named_effects
from models.diagnosis.evidence.noise import noise_mse
from models.diagnosis.evidence.parameters import parameters
from models.diagnosis.evidence.ranking import Ranking, rank
from models.diagnosis.reference.reference import Reference
from models.diagnosis.reference.samples import Samples, all_samples, visible
from models.diagnosis.structure.nuisances import nuisances_of
from models.diagnosis.structure.resolution import resolved
from models.diagnosis.structure.sensitivities import directions_V
from models.effects import Effect
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork

_SAMPLES = 8_000
_HELD_OUT_RIDGE = 1e-5
# Here the own error is what all effects together leave of the same runs: no other record is held against it.
_BIAS_ALLOWANCE = 0.2
_NEARLY = 0.9
_SOC_SLACK = 0.01
# Of a state of charge that a person counted with care.
_SOC_STD = 0.005


@dataclass(frozen=True)
class StructureAnalysis:
    """Everything that structure mode found.

    Attributes
    ----------
    comparison : all runs with the network's error and every effect's regressors
    ranking : of single effects
    named : effects that are named, the larger first
    n_train : samples of the training runs, the first ones
    resolution : bumps of the open-circuit curve that the data ask for beside the network's; 0: none
    """

    comparison: Comparison
    ranking: Ranking
    named: tuple[Named, ...]
    n_train: int
    resolution: int

    @property
    def as_it_is_mse(self) -> float:
        """Mean squared error of the diagnosed runs with the network as it is, V^2."""
        return float(np.mean(self.comparison.evidence.error_V[self.n_train :] ** 2))


def analyse_structure(
    network: LocalModelNetwork,
    reference: Reference,
    train: list[GridRun],
    train_soc: list[float],
    runs: list[GridRun],
    soc: list[float],
    effects: list[Effect],
    soc_std: list[float] | None = None,
) -> StructureAnalysis:
    """Try every effect beside what the network has.

    Parameters
    ----------
    network : the model
    reference : fitted to the same training runs; effects that scale the overvoltage take its resistances
    train, train_soc : what the network was fitted to; empty where it is not at hand
    runs, soc : runs to be explained
    effects : to be tried
    soc_std : standard deviation of the stated SoC of each of these runs; None: that of a careful statement

    Raises
    ------
    ModelError
        The runs can show none of the effects.
    """
    samples = _inside(all_samples(reference, [*train, *runs], [*train_soc, *soc], _SAMPLES), len(train))
    error = np.concatenate([_error_V(network, view.run, view.initial_soc, view.index) for view in samples.views])
    own = np.vstack([directions_V(network, view.run, view.initial_soc, view.index) for view in samples.views])
    open_ = nuisances_of(network, samples.views, [_SOC_STD] * len(train) + (soc_std or [_SOC_STD] * len(runs)))
    usable = _usable(effects, samples, [*train, *runs])
    columns = {effect.name: samples.regressors(effect) for effect in usable}
    evidence, resolution = resolved(samples, error, own, open_, np.hstack(list(columns.values())))
    everything = evidence.solve(np.hstack(list(columns.values()))).cost / len(error)
    noise = min(noise_mse(samples), everything)
    comparison = Comparison(samples, tuple(usable), columns, evidence, everything, noise, _BIAS_ALLOWANCE)
    tried = [try_effect(comparison, effect) for effect in usable]
    candidates = [each for each in tried if _possible(comparison, each)] or tried
    ranking = rank(comparison, candidates)
    n_train = sum(len(view.index) for view in samples.views[: len(train)])
    named = named_effects(comparison, ranking) if ranking.something_new else ()
    # An effect that helps only the runs it was fitted to is none, a second one that does leaves the first alone;
    # without other runs there is nothing to ask.
    if len(named) > 1 and runs and not _bear_out(named, n_train, error[n_train:]):
        named = (Named(comparison, ranking),)
    if len(named) == 1 and not (ranking.significant and (not runs or _bear_out(named, n_train, error[n_train:]))):
        named = ()
    return StructureAnalysis(comparison, ranking, named, n_train, resolution)


def _usable(effects: list[Effect], samples: Samples, runs: list[GridRun]) -> list[Effect]:
    """Effects that a structure can lack and that the runs can show."""
    seen = [each for each in effects if not each.absorbed and visible(each, runs) and each.tells(samples.views)]
    if not seen:
        names = ", ".join(each.name for each in effects) or "any effect"
        raise ModelError(
            f"diagnosis: the runs cannot show {names}; take runs that come back to a state of charge, at more than one "
            "temperature"
        )
    return seen


def _possible(comparison: Comparison, candidate: Candidate) -> bool:
    """Whether an effect is no larger than any cell shows it; one that explains more by being so explains nothing."""
    effect = candidate.effect
    if effect.lean is None or effect.lean.possible is None:
        return True
    first = parameters(comparison, candidate)[effect.parameters[0].name]
    return abs(first.value) <= effect.lean.scale * effect.lean.possible(comparison.runs.views[0])


def _bear_out(named: tuple[Named, ...], n_train: int, error_V: FloatArray) -> bool:
    """Whether the held-out error falls with each effect that is named, and with all that a refit moves beside it.

    Below that of the network as it is: there the parameters that it has may do harm, with or without an effect.
    """
    without = [held_out_mse(each.comparison, n_train) for each in named]
    left = [held_out_mse(each.comparison, n_train, each.ranking.candidates[0]) for each in named]
    # The second one's comparison has the first in the model already.
    steps = [float(np.mean(error_V**2)), *without[1:], left[-1]]
    helps = all(after < before for before, after in zip(without, left, strict=True))
    return helps and all(after < before for before, after in pairwise(steps))


def _inside(samples: Samples, n_train: int) -> Samples:
    """Leave out what lies beyond the SoC of the training runs: there the network is a guess, whatever it lacks."""
    if n_train == 0:
        return samples
    soc = [view.soc[view.index] for view in samples.views]
    known, every = np.concatenate(soc[:n_train]), np.concatenate(soc)
    inside = (every >= known.min() - _SOC_SLACK) & (every <= known.max() + _SOC_SLACK)
    return samples if inside.all() or not inside[len(known) :].any() else samples.kept(inside)


def _error_V(network: LocalModelNetwork, run: GridRun, initial_soc: float, index: np.ndarray) -> FloatArray:
    return run.voltage_V[index] - free_run_V(network, run, initial_soc)[index]


def held_out_mse(comparison: Comparison, n_train: int, candidate: Candidate | None = None) -> float:
    """Mean squared error of the diagnosed runs when network and effect are refitted to the training runs, V^2.

    The effect enters in its smallest form where it has one and that explains nearly as much. Without training runs it
    is the error in held-out blocks.

    Parameters
    ----------
    comparison : of training and diagnosed runs
    n_train : samples of the training runs, the first ones
    candidate : the effect; None: the network alone, or with what the comparison has beside it
    """
    n = n_train
    evidence = comparison.evidence
    x, y = np.zeros((len(evidence.error_V), 0)), evidence.error_V
    if candidate is not None:
        x, y = _form(comparison, candidate), candidate.target_V
    y = y - evidence.of_runs(x, y)
    if n == 0:
        gained = evidence.gains(x, y).sum() if candidate is not None else 0.0
        return float(((evidence.null_errors_V**2).sum() - gained) / len(y))
    model = np.delete(np.arange(evidence.regressors.shape[1]), slice(*evidence.per_run))
    whole, p = np.hstack([evidence.regressors[:, model], x]), len(model)
    # What the training runs do not show stays where it was instead of running away in the others.
    ridge = _HELD_OUT_RIDGE * (whole**2).sum(axis=0) + 1e-12
    information = whole[:n].T @ whole[:n] + np.diag(ridge)
    information[:p, :p] += evidence.information[np.ix_(model, model)]
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
