"""Two effects at once: every pair is tried, and each of the best two has to hold its place beside the other."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.diagnosis.evidence.candidates import Comparison, beside, simulate_again
from models.diagnosis.evidence.evidence import Evidence
from models.diagnosis.evidence.forms import Form, nested
from models.diagnosis.evidence.ranking import Ranking, rank
from models.effects import Effect

# Of a second effect: least size, relative to the first one's, and least share of the rest in held-out blocks.
_LEAST_OF_OTHER, _LEAST_HELD_OUT_SHARE = 0.12, 0.1
# What two must explain beyond one: of what that leaves open, and in prices of a parameter.
_LEAST_OF_REST, _LEAST_GAIN = 0.4, 3.0
_ROUNDS = 3
_INFORMATION = 1e-6


@dataclass(frozen=True)
class Named:
    """One named effect: what it was tried against, beside the other where there are two, and its ranking there."""

    comparison: Comparison
    ranking: Ranking

    @property
    def effect(self) -> Effect:
        """The effect."""
        return self.ranking.candidates[0].effect

    @property
    def effect_name(self) -> str:
        """Name of the effect."""
        return self.effect.name


def named_effects(comparison: Comparison, ranking: Ranking) -> tuple[Named, ...]:
    """One effect, or the two that hold their place beside each other, first the one to begin with.

    Parameters
    ----------
    comparison : of the runs
    ranking : of single effects, where what it names is significant
    """
    alone = (Named(comparison, ranking),)
    forms, price = ranking.forms, ranking.price
    pair = forms.best_pair(price)
    if pair is None or not _worth(ranking, pair):
        return alone
    one, other = (forms.forms[number] for number in pair)
    for _ in range(_ROUNDS):
        first, second = _ranked_beside(comparison, ranking, other, one), _ranked_beside(comparison, ranking, one, other)
        if first is None or second is None:
            return alone
        kept, other_kept = _same(first, one.effect), _same(second, other.effect)
        if kept and other_kept:
            return _accepted(first, second) or alone
        if not kept:
            one = best_form(first.ranking)
        else:
            other = best_form(second.ranking)
    return alone


def _worth(ranking: Ranking, pair: tuple[int, int]) -> bool:
    """Whether two explain most of what one leaves open, or as much as one with more parameters than both have."""
    forms, price = ranking.forms, ranking.price
    best = forms.best(ranking.candidates[0].effect, price)
    single, both = forms.forms[best], [forms.forms[number] for number in pair]
    smaller = sum(form.size for form in both) < single.size and all(form.effect is not single.effect for form in both)
    if smaller and forms.judged(price, *pair) <= forms.judged(price, best) - _LEAST_GAIN * price:
        return True
    alone = forms.cost(best)
    own = len(forms.comparison.evidence.error_V) * forms.comparison.own_mse
    open_V2 = alone - single.inexact - own
    # What the larger of the two is simulated with may be inexact, and hide what both explain.
    gained = max(alone - forms.cost(*pair), forms.judged(0.0, best) - forms.judged(0.0, *pair))
    return gained >= _LEAST_OF_REST * open_V2 and gained >= _LEAST_GAIN * price


def with_form(comparison: Comparison, form: Form) -> Comparison:
    """The comparison once an effect is in the model, with coefficients that are free."""
    evidence = comparison.evidence
    p = evidence.regressors.shape[1]
    information = np.zeros((p + form.columns.shape[1],) * 2)
    information[:p, :p] = evidence.information
    added = np.arange(p, len(information))
    information[added, added] = _INFORMATION * (form.columns**2).sum(axis=0) + 1e-12
    error_V = evidence.error_V if form.fixed_V is None else evidence.error_V - form.fixed_V
    wider = np.hstack([evidence.regressors, form.columns])
    return replace(comparison, evidence=Evidence(error_V, wider, information, evidence.blocks, evidence.per_run))


def _ranked_beside(comparison: Comparison, ranking: Ranking, given: Form, wanted: Form) -> Named | None:
    """Rank the effects once one is in the model; the wanted one is simulated again where it has to be."""
    wider = with_form(comparison, given)
    candidates = []
    for each in ranking.candidates:
        effect = each.effect
        if effect is given.effect or nested(effect, given.effect) or effect.name == given.effect.twin:
            continue
        found = beside(wider, each, comparison)
        if effect is wanted.effect and each.value is not None and found.value is not None:
            found = simulate_again(wider, effect, _within(wider, effect, found.value))
        candidates.append(found)
    return Named(wider, rank(wider, candidates)) if candidates else None


def _same(named: Named, effect: Effect) -> bool:
    """Whether an effect, or its twin, is named: which of the two does best changes from round to round."""
    return named.effect_name in (effect.name, effect.twin)


def _within(comparison: Comparison, effect: Effect, value: float) -> float:
    assert effect.shift is not None
    return float(np.clip(value, *effect.shift.limits(comparison.runs.views[0])))


def best_form(ranking: Ranking) -> Form:
    """The form in which the effect that a ranking names does best."""
    return ranking.forms.forms[ranking.forms.best(ranking.candidates[0].effect, ranking.price)]


def _accepted(first: Named, second: Named) -> tuple[Named, ...] | None:
    """Both, first the one to begin with; None where one is chance, or no more than what the other one's form leaves.

    One begins with that which leaves less of the error when it is added alone: it stands in the other's comparison.
    """
    both = sorted((first, second), key=lambda each: -each.ranking.size_V)
    larger, smaller = (each.ranking for each in both)
    if not (larger.significant and smaller.significant):
        return None
    if smaller.size_V < _LEAST_OF_OTHER * larger.size_V or not smaller.explained:
        return None
    if smaller.held_out_share < _LEAST_HELD_OUT_SHARE:
        return None
    return (first, second) if second.comparison.evidence.cost <= first.comparison.evidence.cost else (second, first)
