"""A leak inside the cell as both channels show it: its power warms the cell, its charge moves the voltage.

A temperature sensor with an offset warms just so, and a sensor of the current drifts just so: only together they tell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.evidence.candidates import Comparison, simulate_again, try_effect
from models.diagnosis.evidence.evidence import Evidence
from models.diagnosis.evidence.joint import Named, best_form, with_form
from models.diagnosis.evidence.memory import Memory
from models.diagnosis.evidence.ranking import Ranking, rank
from models.diagnosis.thermal.channel import ThermalComparison, compare_temperature
from models.effects import Effect
from models.network.signals.filters import low_pass

# Share of what is new in the temperature that the leak must explain: the voltage has to agree beside that.
_EXPLAINS = 0.9
# By how much, relative to it, the leak that the voltage asks for may differ.
_AGREES = 0.5


def named_leak(
    memory: Memory, comparison: Comparison, ranking: Ranking, runs: list[GridRun], soc: list[float]
) -> tuple[Named, ...]:
    """The leak, with one more effect where the voltage shows one; nothing where the two channels do not agree on it.

    Parameters
    ----------
    memory : of the training runs
    comparison, ranking : of the voltage, single effects
    runs, soc : to be diagnosed, with their SoC at the start
    """
    cold: list[FloatArray] = [np.zeros(len(run)) for run in runs]
    thermal = compare_temperature(memory.reference, memory.balance, runs, soc, [], cold)
    if thermal is None:
        return ()
    for effect in comparison.effects:
        if effect.inner_heat_W is not None and effect.shift is not None:
            leak_A = _leak_A(memory, thermal, runs, soc, effect.inner_heat_W)
            low, high = effect.shift.limits(comparison.runs.views[0])
            if leak_A is not None and low < leak_A < high:
                found = _agreed(comparison, ranking, effect, leak_A)
                if found:
                    return found
    return ()


def _agreed(comparison: Comparison, ranking: Ranking, effect: Effect, leak_A: float) -> tuple[Named, ...]:
    """The leak that the temperature asks for, where the voltage asks for about as much; else nothing."""
    evidence = comparison.evidence
    left_V = evidence.error_V - comparison.runs.shifted(effect, leak_A)
    rest = replace(comparison, evidence=Evidence(left_V, evidence.regressors, evidence.information, evidence.blocks))
    drifts = [each for each in comparison.effects if each.name in (effect.name, effect.twin)]
    others = [each for each in comparison.effects if each not in drifts]
    beside = rank(rest, [try_effect(rest, each) for each in others])
    if min(rest.evidence.cost, _least_spent(beside, others)) > _least_spent(ranking, others, pairs=True):
        return ()
    more = (Named(rest, beside),) if beside.significant and beside.explained else ()
    still = with_form(rest, best_form(beside)) if more else rest
    missed_A = simulate_again(still, effect, 0.0).value
    if missed_A is None or abs(missed_A) > _AGREES * leak_A:
        return ()
    whole = with_form(comparison, best_form(beside)) if more else comparison
    leak = Named(whole, _ahead_of_twin(rank(whole, [try_effect(whole, each) for each in drifts]), effect))
    return tuple(sorted((leak, *more), key=lambda each: -each.ranking.size_V))


def _ahead_of_twin(ranking: Ranking, effect: Effect) -> Ranking:
    """The ranking with the leak first, and its twin as its rival: in the voltage alone they are the same."""
    ordered = tuple(sorted(ranking.candidates, key=lambda each: each.effect is not effect))
    return replace(ranking, candidates=ordered, rivals=tuple(each.effect.name for each in ordered[1:]))


def _leak_A(
    memory: Memory,
    thermal: ThermalComparison,
    runs: list[GridRun],
    soc: list[float],
    inner_heat_W: Callable[[FloatArray], FloatArray],
) -> float | None:
    """The leak whose power explains the temperature; None where none does."""
    reference, warm = memory.reference, []
    for view, run, s in zip(thermal.views, runs, soc, strict=True):
        open_circuit_V = reference.open_circuit_V(s + run.charge_Ah / reference.capacity_Ah)
        heat_W = inner_heat_W(open_circuit_V)
        warm.append(view.resistance_K_per_W * low_pass(heat_W, view.time_constant_s, view.dt_s))
    for_one_A = np.concatenate(warm)
    error_K = np.concatenate([view.temperature_degC - view.simulated() for view in thermal.views])
    leak_A = float(for_one_A @ error_K / (for_one_A @ for_one_A))
    left_K2 = float(np.mean((error_K - leak_A * for_one_A) ** 2))
    explained = (thermal.mse_K2 - left_K2) >= _EXPLAINS * (thermal.mse_K2 - thermal.own_mse_K2)
    return leak_A if thermal.large and leak_A > 0.0 and explained else None


def _least_spent(ranking: Ranking, effects: list[Effect], *, pairs: bool = False) -> float:
    """What the best of some effects, or the best two of them, leave with the price of their parameters, V^2."""
    forms, price = ranking.forms, ranking.price
    alone = min(forms.spent(each, price) for each in effects)
    pair = forms.best_pair(price, effects) if pairs else None
    return alone if pair is None else min(alone, forms.judged(price, *pair))
