"""From what each effect makes of the judged runs to probabilities: nothing, one effect, two at once, or unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.likelihood.background import Background, Weighed, log_sum
from models.diagnosis.likelihood.pairs import pair_gains
from models.diagnosis.likelihood.simpler import Simpler, price_of_shape, shares, simplest_first, worsens
from models.diagnosis.likelihood.sizes import widened
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.diagnosis.likelihood.tried import Tried, stacked, together, weigh_both
from models.effects import Effect, effect

_LEAST = 1e-300
# Explanations over which sizes are averaged at the most: more of them add little but time.
_MOST_EXPLANATIONS = 5


@dataclass(frozen=True)
class Verdict:
    """Probabilities.

    Attributes
    ----------
    nothing, unknown : of nothing new, and of something that no effect stands for
    single : of each effect alone, the likeliest first
    pairs : of two effects at once, the likeliest first
    sharper : by how much the logarithm of nothing was lowered beside those of effects
    start_gain : by how much it was raised, before tempering, where the runs begin elsewhere within what is stated
    """

    nothing: float
    unknown: float
    single: tuple[tuple[float, Tried], ...]
    pairs: tuple[tuple[float, Tried, Tried], ...]
    sharper: float = 0.0
    start_gain: float = 0.0

    @property
    def something(self) -> bool:
        """Whether something is said to be there."""
        return self.nothing < THRESHOLDS.claim

    def chance(self, wanted: Sequence[Tried]) -> float:
        """Probability that just these one or two effects are there."""
        every = self.single if len(wanted) == 1 else self.pairs
        names = {each.effect.name for each in wanted}
        return next((p for p, *which in every if {each.effect.name for each in which} == names), 0.0)


def as_whole_loss(
    verdict: Verdict, tried: Sequence[Tried], which: Sequence[Tried], *, electrodes: bool
) -> tuple[Tried, ...] | None:
    """What is told in the place of a cause of a lost capacity: that capacity, where it would do nearly as well.

    Whichever cause it is, the charge that the cell holds is that. By the probabilities, and where the cell's electrodes
    are not known by what each explains: which cause it was rests on the shape of their curves.

    Parameters
    ----------
    verdict, tried : probabilities, and every effect
    which : the likeliest effects
    electrodes : whether the cell's electrodes are known
    """
    whole = next((each for each in tried if each.effect.life == "capacity"), None)
    if whole is None:
        return None
    best = verdict.chance(which)
    for cause in [each for each in which if each.effect.causes]:
        wanted = tuple(each for each in tried if each is whole or (each is not cause and each in which))
        share = whole.weighed.log_likelihood / max(cause.weighed.log_likelihood, THRESHOLDS.asked)
        if THRESHOLDS.rival * verdict.chance(wanted) >= best or (not electrodes and share >= THRESHOLDS.as_good):
            return wanted
    return None


def prior_alone(tried: list[Tried]) -> FloatArray:
    """(effects,) prior probability of each effect alone."""
    share, at = shares(tried), THRESHOLDS
    return (1.0 - at.nothing - at.unknown - at.pairs) * share / share.sum()


def chances_of(
    back: Background, verdict: Verdict, tried: list[Tried], others: list[Tried], n_voltage: int
) -> FloatArray:
    """(others,) probability of effects, alone, that were not weighed with the rest; 0 of one that worsens things.

    Parameters
    ----------
    back : error and covariance
    verdict, tried : of the effects that were weighed
    others : effects that were not
    n_voltage : points of the voltage, the first ones
    """
    alone = np.log(prior_alone([*tried, *others]))[len(tried) :]
    nothing = np.log(THRESHOLDS.nothing) + THRESHOLDS.tempering * verdict.start_gain - verdict.sharper
    logs = _single_logs(alone, others) + np.log(max(verdict.nothing, _LEAST)) - nothing
    worse = [worsens(back, each.contribution, n_voltage) for each in others]
    return np.where(worse, 0.0, np.exp(np.minimum(logs, 0.0)))


def _single_logs(alone: FloatArray, tried: Sequence[Tried]) -> FloatArray:
    """(effects,) logarithm of the weight of each effect alone, by that of its prior."""
    logs = alone + THRESHOLDS.tempering * np.array([each.weighed.log_likelihood for each in tried])
    return logs + np.array([each.rare(each.weighed.mean) for each in tried])


def in_other_explanations(
    back: Background, verdict: Verdict, one: Tried, named: Sequence[Tried], factor: float
) -> list[tuple[float, Weighed]]:
    """Sizes of a named effect in other explanations that are nearly as likely as its likeliest, each with its chance.

    Parameters
    ----------
    back, verdict : error and covariance, and what is how likely
    one, named : the effect, alone or with the other that is named
    factor : of the learned differences between runs, as in `widened`
    """
    told, mine = {each.effect.name for each in named}, []
    for p, *which in (*verdict.single, *verdict.pairs):
        if any(each is one for each in which):
            mine.append((p, which))
    best = max((p for p, _ in mine), default=0.0)
    near = [(p, which) for p, which in mine if p * THRESHOLDS.rival >= best and {e.effect.name for e in which} != told]
    found = []
    for p, which in sorted(near, key=lambda each: -each[0])[:_MOST_EXPLANATIONS]:
        every = widened(back, together(back, which)[0], *stacked(which), factor)
        first = 0 if which[0] is one else which[0].columns.shape[1]
        part = slice(first, first + one.columns.shape[1])
        found.append((p, Weighed(every.log_likelihood, every.mean[part], every.covariance[part, part])))
    return found


def _likely(a: Effect, b: Effect) -> float:
    """Weight of a pair; a cause of a lost capacity beside all of that loss, or what looks like it, is none."""
    if (a.causes and _is_loss(b)) or (b.causes and _is_loss(a)):
        return 0.0
    return THRESHOLDS.twins if b.name == a.twin else 1.0


def _is_loss(one: Effect) -> bool:
    return one.life == "capacity" or any(effect(name).life == "capacity" for name in one.like)


def judge(back: Background, tried: list[Tried], n_voltage: int, start_gain: float = 0.0) -> Verdict:
    """Weigh everything against everything.

    Parameters
    ----------
    back : error and covariance
    tried : every effect
    n_voltage : points of the voltage, the first ones
    start_gain : by how much nothing is likelier (logarithm) where the runs begin elsewhere within what is stated
    """
    at = THRESHOLDS
    share, alone = shares(tried), np.log(prior_alone(tried))
    couples = [] if len(tried) < 2 else list(combinations(range(len(tried)), 2))
    products = np.array([share[i] * share[j] * _likely(tried[i].effect, tried[j].effect) for i, j in couples])
    with np.errstate(divide="ignore"):
        joint = np.log(at.pairs * products / max(products.sum(), _LEAST))
    gains = pair_gains(back, [each.columns for each in tried], [each.moved for each in tried], couples)
    broken = np.array([tried[i].broken + tried[j].broken for i, j in couples])
    single_logs = _single_logs(alone, tried)
    simpler = Simpler(back, tried, n_voltage)
    single_logs[[simpler.single(i) for i in range(len(tried))]] = -np.inf
    joint_logs = joint + at.tempering * (np.array(gains) - broken)
    simplest_first(tried, couples, single_logs, joint_logs)
    price_of_shape(tried, couples, single_logs, joint_logs)
    nothing_logs = np.array(
        [np.log(at.nothing) + at.tempering * start_gain, np.log(at.unknown) + at.tempering * back.unknown]
    )
    least = max(float(nothing_logs.max()), *single_logs.tolist()) - at.in_question
    for c in np.argsort(-joint_logs):
        if joint_logs[c] < least:
            break
        i, j = couples[c]
        part, more = weigh_both(back, (tried[i], tried[j]))
        joint_logs[c] = -np.inf if simpler.pair(i, j, part) else joint_logs[c] + more
        if joint_logs[c] > least + at.in_question:
            least = max(least, float(joint_logs[c]) - at.in_question)
    # Which effect it is rests on the effects' equations, too; whether there is one on the known errors alone.
    gain = np.concatenate([[each.weighed.log_likelihood for each in tried], np.array(gains) - broken])
    likeliest = int(np.argmax(np.concatenate([single_logs, joint_logs])))
    sharper = (back.tempering - at.tempering) * max(float(gain[likeliest]) - start_gain, 0.0)
    nothing_logs[0] -= sharper
    logs = np.concatenate([nothing_logs, single_logs, joint_logs])
    posterior = np.exp(logs - log_sum(logs))
    single = sorted(zip(posterior[2 : 2 + len(tried)].tolist(), tried, strict=True), key=lambda pair: -pair[0])
    pairs = sorted(
        ((float(p), tried[i], tried[j]) for p, (i, j) in zip(posterior[2 + len(tried) :], couples, strict=True)),
        key=lambda each: -each[0],
    )
    return Verdict(float(posterior[0]), float(posterior[1]), tuple(single), tuple(pairs), sharper, start_gain)
