"""From what each effect makes of the judged runs to probabilities: nothing, one effect, two at once, or unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.likelihood.background import Background, Weighed, Whitened, log_sum
from models.diagnosis.likelihood.pairs import pair_gains
from models.diagnosis.likelihood.shapes import Linear, Moving
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.effects import Effect

_STEPS = 4
_SETTLED = 0.05
_LEAST = 1e-300


@dataclass(frozen=True)
class Tried:
    """One effect in its likeliest shape.

    Attributes
    ----------
    effect : tried
    shape : the likeliest
    columns : (N, k) for usual sizes, or derivatives about what was moved
    moved : (N,) what is taken off the error first; None: nothing
    weighed : its evidence, that of all shapes together
    broken : what is taken off the logarithm of the likelihood, because a simulation does not bear it out
    """

    effect: Effect
    shape: Linear | Moving
    columns: FloatArray
    moved: FloatArray | None
    weighed: Weighed
    broken: float = 0.0

    @property
    def contribution(self) -> FloatArray:
        """(N,) its part of both channels."""
        return self.part(self.weighed.mean)

    def part(self, sizes: FloatArray) -> FloatArray:
        """(N,) the same for other sizes."""
        part = self.columns @ sizes
        return part if self.moved is None else part + self.moved


def try_shapes(back: Background, one: Effect, shapes: tuple[Linear | Moving, ...]) -> Tried:
    """Weigh an effect over all its shapes."""
    every = [_linear(back, one, shape) if isinstance(shape, Linear) else _moving(back, one, shape) for shape in shapes]
    best = max(every, key=lambda each: each.weighed.log_likelihood)
    together = log_sum([each.weighed.log_likelihood for each in every]) - float(np.log(len(every)))
    return replace(best, weighed=replace(best.weighed, log_likelihood=together))


def _linear(back: Background, one: Effect, shape: Linear) -> Tried:
    return Tried(one, shape, shape.columns, None, back.weigh(shape.columns))


def _moving(back: Background, one: Effect, shape: Moving) -> Tried:
    """Simulate again about what the runs ask for, from each start; the likeliest of what was simulated is taken."""
    seen: list[Tried] = []
    for start in (_best_start(back, shape),) if shape.from_best else shape.starts:
        sizes = np.array(start)
        for _ in range(_STEPS):
            at, columns = shape.columns(sizes)
            moved = at - columns @ sizes
            whitened = back.whiten(columns, moved)
            weighed = back.weigh_whitened(whitened)
            broken = _broken(back, shape, weighed, whitened)
            weighed = replace(weighed, log_likelihood=weighed.log_likelihood - broken)
            seen.append(Tried(one, shape, columns, moved, weighed, broken))
            asked = np.clip(back.step(whitened), *shape.limits)
            settled = bool(np.abs(asked - sizes).max() < _SETTLED)
            sizes = asked
            if settled:
                break
    return max(seen, key=lambda each: each.weighed.log_likelihood)


def _best_start(back: Background, shape: Moving) -> tuple[float, ...]:
    """The start that leaves least."""
    left = np.column_stack([back.error - shape.simulate(np.array(start)) for start in shape.starts])
    return shape.starts[int(np.argmin(np.sum(back.white(left, 1.0) ** 2, axis=0)))]


def _broken(back: Background, shape: Moving, weighed: Weighed, whitened: list[Whitened]) -> float:
    """How much evidence the derivatives promise beyond what a simulation of the likeliest size bears out."""
    truly = shape.simulate(np.clip(weighed.mean, *shape.limits))
    broken = 0.0
    for (scale, _), each, error in zip(THRESHOLDS.effect_scales, whitened, back.white_errors, strict=True):
        if scale in THRESHOLDS.scales:
            promised, left = each.error - each.columns @ weighed.mean, error - back.white(truly, scale)
            broken = max(broken, 0.5 * float(left @ left - promised @ promised))
    return broken


@dataclass(frozen=True)
class Verdict:
    """Probabilities.

    Attributes
    ----------
    nothing, unknown : of nothing new, and of something that no effect stands for
    single : of each effect alone, the likeliest first
    pairs : of two effects at once, the likeliest first
    """

    nothing: float
    unknown: float
    single: tuple[tuple[float, Tried], ...]
    pairs: tuple[tuple[float, Tried, Tried], ...]

    @property
    def something(self) -> bool:
        """Whether something is said to be there."""
        return self.nothing < THRESHOLDS.claim


def together(back: Background, several: Sequence[Tried]) -> tuple[Weighed, FloatArray]:
    """Sizes of effects that are there at once, in their order, and (N,) what they stand for."""
    moved = [each.moved for each in several if each.moved is not None]
    columns = np.column_stack([each.columns for each in several])
    whole = np.sum(moved, axis=0) if moved else None
    weighed = back.weigh(columns, whole)
    part = columns @ weighed.mean
    return weighed, part if whole is None else part + whole


def _worsens(back: Background, contribution: FloatArray, n_voltage: int) -> bool:
    """Whether an explanation raises the error of the voltage instead of lowering it."""
    before, part = back.error[:n_voltage], contribution[:n_voltage]
    return float(np.mean((before - part) ** 2)) > THRESHOLDS.worse**2 * float(np.mean(before**2))


def prior_alone(tried: list[Tried]) -> FloatArray:
    """(effects,) prior probability of each effect alone."""
    share, at = _shares(tried), THRESHOLDS
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
    logs = alone + THRESHOLDS.tempering * np.array([each.weighed.log_likelihood for each in others])
    logs += np.log(max(verdict.nothing, _LEAST)) - np.log(THRESHOLDS.nothing)
    worse = [_worsens(back, each.contribution, n_voltage) for each in others]
    return np.where(worse, 0.0, np.exp(np.minimum(logs, 0.0)))


def _likely(a: Effect, b: Effect) -> float:
    return THRESHOLDS.twins if b.name == a.twin else 1.0


def _shares(tried: list[Tried]) -> FloatArray:
    return np.array([each.effect.expected.share for each in tried])


def _simplest_first(
    tried: list[Tried], couples: list[tuple[int, int]], single_logs: FloatArray, joint_logs: FloatArray
) -> None:
    """Give special cases that explain nearly as much as a free curve their share of what speaks for that.

    A curve over the state of charge can be bent to what a model is off by, too; a cause of one size, with which nearly
    all of it is explained, cannot. Alone or beside another effect they divide the curve's probability among them, by
    their prior shares and by what each explains.

    Parameters
    ----------
    tried : every effect
    couples : numbers of the effects of each pair
    single_logs, joint_logs : logarithms of the probabilities, changed in place
    """
    at, number = THRESHOLDS, {each.effect.name: i for i, each in enumerate(tried)}
    place = {pair: c for c, pair in enumerate(couples)}
    logs = [each.weighed.log_likelihood for each in tried]
    for e, general in enumerate(tried):
        if general.effect.local is None or not general.effect.absorbed or logs[e] < at.asked:
            continue
        inner = [number[name] for name in general.effect.contains if name in number]
        worth = [i for i in inner if logs[i] >= at.as_good * logs[e] and np.isfinite(single_logs[i])]
        best = max((logs[i] for i in worth), default=0.0)
        own = float(np.log(general.effect.expected.share))
        parts = {i: float(np.log(tried[i].effect.expected.share)) + at.tempering * (logs[i] - best) for i in worth}
        whole = log_sum([own, *parts.values()])
        parts, kept = {i: part - whole for i, part in parts.items()}, own - whole
        for i, part in parts.items():
            single_logs[i] = max(single_logs[i], single_logs[e] + part)
        single_logs[e] += kept
        for other in set(range(len(tried))) - {e, *worth}:
            free = place[min(e, other), max(e, other)]
            for i, part in parts.items():
                both = place[min(i, other), max(i, other)]
                joint_logs[both] = max(joint_logs[both], joint_logs[free] + part)
            joint_logs[free] += kept


def judge(back: Background, tried: list[Tried], n_voltage: int) -> Verdict:
    """Weigh everything against everything.

    Parameters
    ----------
    back : error and covariance
    tried : every effect
    n_voltage : points of the voltage, the first ones
    """
    at = THRESHOLDS
    share, alone = _shares(tried), np.log(prior_alone(tried))
    couples = [] if len(tried) < 2 else list(combinations(range(len(tried)), 2))
    products = np.array([share[i] * share[j] * _likely(tried[i].effect, tried[j].effect) for i, j in couples])
    joint = np.log(at.pairs * products / max(products.sum(), 1e-300))
    gains = pair_gains(back, [each.columns for each in tried], [each.moved for each in tried], couples)
    broken = np.array([tried[i].broken + tried[j].broken for i, j in couples])
    single_logs = alone + at.tempering * np.array([each.weighed.log_likelihood for each in tried])
    single_logs[[_worsens(back, each.contribution, n_voltage) for each in tried]] = -np.inf
    joint_logs = joint + at.tempering * (np.array(gains) - broken)
    _simplest_first(tried, couples, single_logs, joint_logs)
    nothing_logs = np.array([np.log(at.nothing), np.log(at.unknown) + at.tempering * back.unknown])
    least = max(float(nothing_logs.max()), *single_logs.tolist()) - at.in_question
    for c in np.argsort(-joint_logs):
        if joint_logs[c] < least:
            break
        both = [tried[number] for number in couples[c]]
        if _worsens(back, together(back, both)[1], n_voltage):
            joint_logs[c] = -np.inf
        else:
            least = max(least, float(joint_logs[c]) - at.in_question)
    logs = np.concatenate([nothing_logs, single_logs, joint_logs])
    posterior = np.exp(logs - log_sum(logs))
    single = sorted(zip(posterior[2 : 2 + len(tried)].tolist(), tried, strict=True), key=lambda pair: -pair[0])
    pairs = sorted(
        ((float(p), tried[i], tried[j]) for p, (i, j) in zip(posterior[2 + len(tried) :], couples, strict=True)),
        key=lambda each: -each[0],
    )
    return Verdict(float(posterior[0]), float(posterior[1]), tuple(single), tuple(pairs))
