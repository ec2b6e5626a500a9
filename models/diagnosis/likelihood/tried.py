"""What one effect makes of the judged runs, in its likeliest shape, and what several make of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.likelihood.background import Background, Weighed, Whitened, log_sum
from models.diagnosis.likelihood.profile import profile
from models.diagnosis.likelihood.shapes import Linear, Moving
from models.diagnosis.likelihood.sizes import possible
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.effects import Effect

_STEPS = 4
_SETTLED = 0.05


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
    shapes : all that were tried
    """

    effect: Effect
    shape: Linear | Moving
    columns: FloatArray
    moved: FloatArray | None
    weighed: Weighed
    broken: float = 0.0
    shapes: tuple[Linear | Moving, ...] = ()

    @property
    def contribution(self) -> FloatArray:
        """(N,) its part of both channels."""
        return self.part(self.weighed.mean)

    def part(self, sizes: FloatArray) -> FloatArray:
        """(N,) the same for other sizes."""
        part = self.columns @ sizes
        return part if self.moved is None else part + self.moved

    def truly(self, sizes: FloatArray) -> FloatArray:
        """(N,) the same, simulated where it bends."""
        shape = self.shape
        return shape.simulate(np.clip(sizes, *shape.limits)) if isinstance(shape, Moving) else self.part(sizes)

    def rare(self, sizes: FloatArray) -> float:
        """Logarithm of how much rarer sizes are than usual ones, of what tempering leaves out of that.

        What the samples say is tempered, not how large a usual change is (Grünwald and van Ommen, Bayesian Anal. 12,
        2017). By the widest of `sizes`, so that nothing is taken off a usual one; of a change of one size alone, for
        what a shape pays is in its determinant.
        """
        if len(sizes) > 1:
            return 0.0
        return -0.5 * (1.0 - THRESHOLDS.tempering) * float(sizes[0] / max(THRESHOLDS.sizes)) ** 2


def alike(named: Tried, other: Tried) -> bool:
    """Whether an effect that most runs can hardly tell from the named one explains nearly as much."""
    like = other.effect.name in named.effect.like or named.effect.name in other.effect.like
    return like and other.weighed.log_likelihood >= THRESHOLDS.as_good * named.weighed.log_likelihood


def once(*tried: Tried) -> tuple[Tried, ...]:
    """Each effect where it stands first."""
    found: dict[str, Tried] = {}
    for each in tried:
        found.setdefault(each.effect.name, each)
    return tuple(found.values())


def try_shapes(back: Background, one: Effect, shapes: tuple[Linear | Moving, ...]) -> Tried:
    """Weigh an effect over all its shapes."""
    every = [_linear(back, one, shape) if isinstance(shape, Linear) else _moving(back, one, shape) for shape in shapes]
    best = max(every, key=lambda each: each.weighed.log_likelihood)
    together = log_sum([each.weighed.log_likelihood for each in every]) - float(np.log(len(every)))
    return replace(best, weighed=replace(best.weighed, log_likelihood=together), shapes=shapes)


def _linear(back: Background, one: Effect, shape: Linear) -> Tried:
    weighed, more = possible(back.weigh(shape.columns), shape.least)
    return Tried(one, shape, shape.columns, None, replace(weighed, log_likelihood=weighed.log_likelihood + more))


def _moving(back: Background, one: Effect, shape: Moving) -> Tried:
    return _profiled(back, one, shape) if shape.size == 1 else _searched(back, one, shape)


def _profiled(back: Background, one: Effect, shape: Moving) -> Tried:
    """One size: all of them are simulated."""
    found = profile(back, shape)
    moved = found.at - found.size * found.columns[:, 0]
    whitened = back.whiten(found.columns, moved)
    broken = _broken(back, shape, back.weigh_whitened(whitened), whitened)
    return Tried(one, shape, found.columns, moved, found.weighed, broken)


def _searched(back: Background, one: Effect, shape: Moving) -> Tried:
    """Simulate again about what the runs ask for, from each start; the likeliest of what was simulated is taken."""
    seen: list[Tried] = []
    for start in shape.starts:
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


def _broken(back: Background, shape: Moving, weighed: Weighed, whitened: list[Whitened]) -> float:
    """How much evidence the derivatives promise beyond what a simulation of the likeliest size bears out."""
    truly = shape.simulate(np.clip(weighed.mean, *shape.limits))
    promised = [each.error - each.columns @ weighed.mean for each in whitened]
    return _beyond(back, truly, promised)


def _beyond(back: Background, truly: FloatArray, promised: Sequence[FloatArray]) -> float:
    """Gain of the logarithm in what derivatives leave, by the root for each scale, over what a simulation leaves."""
    broken, scales = 0.0, [scale for scale, _ in THRESHOLDS.effect_scales]
    for scale, less, error, white in zip(scales, promised, back.white_errors, back.whites(truly, scales), strict=True):
        if scale in THRESHOLDS.scales:
            left = error - white
            broken = max(broken, 0.5 * float(left @ left - less @ less))
    return broken


def weigh_both(back: Background, both: Sequence[Tried]) -> tuple[FloatArray, float]:
    """(N,) what two effects stand for at once, and what is added to the logarithm of their posterior for their sizes.

    Beside each other both have other sizes than alone, for which derivatives may promise what no simulation bears out.
    """
    weighed, part, can_be = _together(back, both)
    first = both[0].columns.shape[1]
    sizes = (weighed.mean[:first], weighed.mean[first:])
    truly = np.sum([each.truly(own) for each, own in zip(both, sizes, strict=True)], axis=0)
    scales = [scale for scale, _ in THRESHOLDS.effect_scales]
    promised = [error - white for error, white in zip(back.white_errors, back.whites(part, scales), strict=True)]
    broken = _beyond(back, truly, promised) - sum(each.broken for each in both)
    rare = sum(each.rare(own) for each, own in zip(both, sizes, strict=True))
    return part, rare + THRESHOLDS.tempering * (can_be - max(broken, 0.0))


def together(back: Background, several: Sequence[Tried]) -> tuple[Weighed, FloatArray]:
    """Sizes of effects that are there at once, in their order, and (N,) what they stand for."""
    weighed, part, _ = _together(back, several)
    return weighed, part


def stacked(several: Sequence[Tried]) -> tuple[FloatArray, FloatArray | None]:
    """(N, k) columns of effects in their order, and (N,) what is taken off the error first, if anything is."""
    moved = [each.moved for each in several if each.moved is not None]
    return np.column_stack([each.columns for each in several]), np.sum(moved, axis=0) if moved else None


def _together(back: Background, several: Sequence[Tried]) -> tuple[Weighed, FloatArray, float]:
    columns, whole = stacked(several)
    weighed, can_be, column = back.weigh(columns, whole), 0.0, 0
    for each in several:
        if isinstance(each.shape, Linear):
            weighed, more = possible(weighed, each.shape.least, column)
            can_be += more
        column += each.columns.shape[1]
    part = columns @ weighed.mean
    return weighed, part if whole is None else part + whole, can_be
