"""Change mode: the model was right, and what is asked is what has changed in the cell or the rig since."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.change.leak import named_leak
from models.diagnosis.evidence.candidates import Candidate, Comparison, compare_samples, lean_columns, try_effect
from models.diagnosis.evidence.joint import Named, best_form, named_effects, with_form
from models.diagnosis.evidence.memory import SAMPLES, Memory
from models.diagnosis.evidence.ranking import Ranking, rank
from models.diagnosis.reference.reference import Reference
from models.diagnosis.reference.samples import choose_samples, visible
from models.diagnosis.thermal.channel import ThermalComparison, WarmthTrial, compare_temperature
from models.effects import Effect
from models.effects.reading import Reading
from models.effects.view import View

# An effect on the SoC that explains this share of the best decides which samples are looked at.
_MOVER_SHARE, _LEAST_BEYOND_SHARE = 0.3, 0.002
# Least share of the squared error of the temperature that an effect on it must explain: ageing alone reaches 0.90.
_WARMTH_SHARE = 0.95
# Share of what the best effect leaves that may remain where a second one is named beside it.
_SECOND_LEAVES = 0.15


@dataclass(frozen=True)
class ChangeAnalysis:
    """Everything that change mode found.

    Attributes
    ----------
    reference : model that the runs were held against
    comparison, ranking : of the voltage, single effects; None where too few samples lie in the trained domain, or none
        of the effects shows in it
    named : effects on the voltage that are named, the larger first
    thermal : of the temperature; None where it cannot be judged
    warmth : effects on the temperature that are named, the larger first
    """

    reference: Reference
    comparison: Comparison | None
    ranking: Ranking | None
    named: tuple[Named, ...]
    thermal: ThermalComparison | None
    warmth: tuple[WarmthTrial, ...]


def analyse_change(memory: Memory, runs: list[GridRun], soc: list[float], effects: list[Effect]) -> ChangeAnalysis:
    """Hold runs against what is remembered of the cell as it was.

    Parameters
    ----------
    memory : of the training runs
    runs, soc : to be diagnosed, with their SoC at the start
    effects : to be tried
    """
    reference = memory.reference
    comparison, ranking = _voltage(memory, runs, soc, effects)
    if comparison is not None and ranking is not None and ranking.something_new:
        leak = named_leak(memory, comparison, ranking, runs, soc)
        if leak:
            return ChangeAnalysis(reference, comparison, ranking, leak, None, ())
    heatless = [_heatless_V(reference, ranking, run, s) for run, s in zip(runs, soc, strict=True)]
    thermal = compare_temperature(reference, memory.balance, runs, soc, effects, heatless)
    warmth = _named_warmth(thermal)
    if warmth and any(part.any() for part in heatless):
        # Whether a changed voltage warms the cell is an assumption: the finding must not hang on it.
        cold = [0.0 * part for part in heatless]
        again = _named_warmth(compare_temperature(reference, memory.balance, runs, soc, effects, cold))
        warmth = tuple(each for each in warmth if any(each.effect is other.effect for other in again))
    misread = [each for each in warmth if each.effect.correction is not None]
    if misread:
        comparison, ranking = _voltage(memory, [_true_temperature(run, misread) for run in runs], soc, effects)
    named = _named(comparison, ranking)
    if comparison is not None:
        named, warmth = _causes_for_heat(comparison, named, warmth)
    return ChangeAnalysis(reference, comparison, ranking, named, thermal, warmth)


def _causes_for_heat(
    comparison: Comparison, named: tuple[Named, ...], warmth: tuple[WarmthTrial, ...]
) -> tuple[tuple[Named, ...], tuple[WarmthTrial, ...]]:
    """Put the cause of a heat in its place: a voltage that moves with temperature makes reversible heat, and is one."""
    for heat in warmth:
        cause = next((each for each in comparison.effects if each.heats_as == heat.effect.name), None)
        both = None if cause is None else _with_cause(comparison, named, cause, heat.values[0])
        if both is not None:
            named, warmth = both, tuple(each for each in warmth if each is not heat)
    return named, warmth


def _with_cause(
    comparison: Comparison, named: tuple[Named, ...], cause: Effect, value: float
) -> tuple[Named, ...] | None:
    """Name the cause of a heat where the voltage moves as the heat asks for, rather than not at all; else None.

    Parameters
    ----------
    comparison, named : of the voltage
    cause : effect whose first parameter is that of the heat
    value : of the parameter
    """
    if any(each.effect is cause for each in named):
        return named
    if cause.lean is None:
        return None
    beside = comparison if not named else with_form(comparison, best_form(named[0].ranking))
    evidence = beside.evidence
    moved_V = value * lean_columns(beside, cause.lean, 0.0)[:, 0]
    if evidence.cost_of(evidence.error_V - moved_V) >= evidence.cost:
        return None
    return (*named, Named(beside, rank(beside, [try_effect(beside, cause)])))


def _named(comparison: Comparison | None, ranking: Ranking | None) -> tuple[Named, ...]:
    """One effect that explains most of what is new, or two that do so together."""
    if comparison is None or ranking is None or not ranking.something_new:
        return ()
    found = named_effects(comparison, ranking)
    if len(found) > 1:
        return found
    return found if ranking.significant and ranking.explained else ()


def _voltage(
    memory: Memory, runs: list[GridRun], soc: list[float], effects: list[Effect]
) -> tuple[Comparison | None, Ranking | None]:
    reference = memory.reference
    samples = choose_samples(reference, runs, soc, SAMPLES)
    usable = [effect for effect in effects if effect.name in memory.names and visible(effect, runs)]
    if not usable or len(samples.blocks) < _least_samples(reference):
        return None, None
    usable.sort(key=lambda effect: memory.names.index(effect.name))
    comparison = compare_samples(memory, samples, usable)
    candidates = [try_effect(comparison, effect) for effect in usable]
    ranking = rank(comparison, candidates)
    mover, known = _inside_known_soc(comparison, candidates)
    if mover is None or np.count_nonzero(known) < _least_samples(reference):
        return comparison, ranking
    narrower = compare_samples(memory, samples.kept(known), usable)
    again = rank(narrower, [try_effect(narrower, effect) for effect in usable])
    return (narrower, again) if again.candidates[0].effect is mover.effect else (comparison, ranking)


def _inside_known_soc(comparison: Comparison, candidates: list[Candidate]) -> tuple[Candidate | None, np.ndarray]:
    """Return the best effect on the SoC, and (n,) samples that stay where the curve is known if it is true.

    Beyond its range the curve is a guess, and a curve over counted SoC would win for bending there as it likes.
    No effect is returned where none explains much, or hardly any sample leaves the range.
    """
    everything = np.ones(len(comparison.evidence.error_V), dtype=bool)
    cost = comparison.evidence.cost
    movers = [each for each in candidates if each.effect.shift is not None and each.effect.shift.soc is not None]
    if not movers:
        return None, everything
    mover = min(movers, key=lambda each: each.solution.cost)
    most = cost - min(each.solution.cost for each in candidates)
    if cost - mover.solution.cost < _MOVER_SHARE * most or mover.value is None:
        return None, everything
    beyond = comparison.runs.beyond(mover.effect, mover.value)
    inside = np.asarray(~(beyond > 0.0).any(axis=1))
    return (mover, inside) if np.mean(inside) < 1.0 - _LEAST_BEYOND_SHARE else (None, everything)


def _heatless_V(reference: Reference, ranking: Ranking | None, run: GridRun, initial_soc: float) -> FloatArray:
    """(n,) part of the voltage that the named effect stands for without warming the cell."""
    if ranking is None or not (ranking.significant and ranking.explained):
        return np.zeros(len(run))
    named = ranking.candidates[0]
    if named.effect.overpotential:
        return np.zeros(len(run))
    return contribution_V(reference, named, run, initial_soc)


def _least_samples(reference: Reference) -> int:
    return 2 * len(reference.coefficients)


def _named_warmth(thermal: ThermalComparison | None) -> tuple[WarmthTrial, ...]:
    """One effect that explains nearly all of what is new, or two where the second takes most of what one leaves."""
    if thermal is None or not thermal.trials or not thermal.large:
        return ()
    best = thermal.trials[0]
    pair = thermal.pairs[0] if thermal.pairs else (best,)
    if pair[0].mse_K2 <= _SECOND_LEAVES * best.mse_K2 and thermal.share_of_new(pair[0]) >= _WARMTH_SHARE:
        order = [trial.effect.name for trial in thermal.trials]
        return tuple(sorted(pair, key=lambda each: order.index(each.effect.name)))
    return (best,) if thermal.share_of_new(best) >= _WARMTH_SHARE else ()


def _true_temperature(run: GridRun, misread: list[WarmthTrial]) -> GridRun:
    """What the sensor should have read."""
    read = Reading(run.current_A, run.voltage_V, run.temperature_degC, run.ambient_degC)
    for trial in misread:
        correction = trial.effect.correction
        if correction is not None and correction.sample is not None:
            read = correction.sample(read, trial.named_values)
    return replace(run, temperature_degC=read.temperature_degC)


def contribution_V(reference: Reference, candidate: Candidate, run: GridRun, initial_soc: float) -> FloatArray:
    """(n,) part of the voltage of a whole run that an effect stands for."""
    view = View(reference, run, initial_soc, np.arange(len(run)))
    effect = candidate.effect
    if effect.shift is not None and candidate.value is not None:
        return effect.shift.voltage(view, candidate.value)
    assert effect.regressors is not None
    return effect.regressors(view) @ candidate.solution.coefficients
