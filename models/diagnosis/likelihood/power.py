"""The smallest size of each effect that these runs would have shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr, ndtri

from models.data.timeseries import FloatArray
from models.diagnosis.likelihood.background import Background, log_sum
from models.diagnosis.likelihood.shapes import Linear, Moving, unseen_shapes
from models.diagnosis.likelihood.sight import Sight
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.diagnosis.likelihood.tried import Tried, try_shapes
from models.diagnosis.likelihood.verdict import prior_alone
from models.effects import Effect

# Sizes, in units of the usual one, that are looked through.
_SEARCH, _CLOSE = (1e-3, 1e3), 0.02
# Standard deviations between which luck is looked through.
_UNLUCKY = (-6.0, 6.0)
_ROUNDS = 2
# A shape that makes less than this part of what another one of the same size makes is hardly in the runs.
_HARDLY = 0.1
# An effect whose search goes further one way by this is of that way alone: nobody finds what he lost.
_ONE_SIDED = 0.1


@dataclass(frozen=True)
class Power:
    """The smallest size of an effect that would have been seen.

    Attributes
    ----------
    effect : which
    size, unit : of its first figure; infinite: none would
    rms_V, rms_K : what it makes of the voltage, and of the temperature where that is looked at
    """

    effect: Effect
    size: float
    unit: str
    rms_V: float
    rms_K: float | None


def first_direction(tried: Tried) -> tuple[FloatArray, str, str]:
    """(k,) sizes of the columns that are one unit of the effect's first figure together, its name and its unit."""
    if isinstance(tried.shape, Moving):
        first, k = tried.effect.parameters[0], tried.shape.size
        at = tried.shape.physical(np.zeros(k))[0]
        moved = [tried.shape.physical(1e-3 * unit)[0] - at for unit in np.eye(k)]
        weights, name, unit = np.array(moved) / 1e-3, first.name, first.unit
    else:
        told = tried.shape.told[len(tried.shape.told) // 2]
        weights, name, unit = np.array(told.weights), told.name, told.unit
    return weights / max(float(weights @ weights), 1e-300), name, unit


def change_at(tried: Tried, size: float) -> FloatArray:
    """(N,) what an effect whose first figure has a size makes of both channels: simulated where it bends."""
    sizes = size * first_direction(tried)[0]
    if isinstance(tried.shape, Moving):
        return tried.shape.simulate(np.clip(sizes, *tried.shape.limits))
    return tried.columns @ sizes


def smallest_shown(back: Background, tried: Tried, prior: float, explained: FloatArray) -> float:
    """Size in the unit of the effect's first figure that would have been told from nothing; infinite where none is.

    Parameters
    ----------
    back : error of the runs, and its covariance
    tried : the effect
    prior : its probability
    explained : (N,) part of the error that another effect is named for
    """
    size = _along(back, tried, tried.columns @ first_direction(tried)[0], prior, explained)
    if not isinstance(tried.shape, Moving):
        return size
    # What bends shows at its own size, up and down, not by its slope somewhere; said is the larger of the two.
    ways = [_furthest(tried, tried.shape, sign) for sign in (1.0, -1.0)]
    asked = [each for each in ways if abs(each) > _ONE_SIDED * max(map(abs, ways))]
    return max(_bent(back, tried, each, size, prior, explained) for each in asked)


def _furthest(tried: Tried, shape: Moving, sign: float) -> float:
    """The furthest size, in the unit of the first figure, that is looked for in one direction."""
    along = sign * first_direction(tried)[0]
    moved = along != 0.0
    limits = np.where(along > 0.0, shape.limits[1], shape.limits[0])
    return sign * float(np.min(limits[moved] / along[moved]))


def _bent(back: Background, tried: Tried, furthest: float, size: float, prior: float, explained: FloatArray) -> float:
    """Size of what bends that shows, from the one by its slope on; infinite where none is that far."""
    for _ in range(_ROUNDS):
        at = float(np.copysign(min(size, abs(furthest)), furthest))
        size = _along(back, tried, change_at(tried, at) / at, prior, explained)
    return size if size <= abs(furthest) else np.inf


def power_of(
    sight: Sight,
    back: Background,
    tried: Sequence[Tried],
    absent: Sequence[Effect],
    untold: Sequence[Tried],
    explained: FloatArray,
) -> list[Power]:
    """Each effect with the smallest size that would have been seen.

    Parameters
    ----------
    sight, back : the runs, their error, and its covariance
    tried : effects
    absent : effects that have no shape in these runs: those are asked about that might have had one, others never show
    untold : effects that these runs do not tell from what any cell does, however large
    explained : (N,) part of the error that another effect is named for
    """
    might = [(one, unseen_shapes(sight, one)) for one in absent]
    every = [*tried, *(try_shapes(back, one, shapes) for one, shapes in might if shapes)]
    found = []
    priors = [*prior_alone(list(tried)), *prior_alone(every)[len(tried) :]]
    for each, prior in zip(every, priors, strict=True):
        size, shaped = _over_shapes(back, each, float(prior), explained)
        if each.effect.expected.found_from is not None:
            size = max(size, min(each.effect.expected.found_from(run.points) for run in sight.runs))
        shown = change_at(shaped, size) if np.isfinite(size) else np.full(len(back.error), np.inf)
        volts, kelvins = np.split(shown, [sight.n_voltage])
        rms_K = float(np.sqrt(np.mean(kelvins**2))) if len(kelvins) else None
        rms_V = float(np.sqrt(np.mean(volts**2)))
        found.append(Power(each.effect, size, first_direction(shaped)[2], rms_V, rms_K))
    never = [(each.effect, first_direction(each)[2]) for each in untold]
    never += [(one, one.parameters[0].unit) for one, shapes in might if not shapes]
    return found + [Power(one, np.inf, unit, np.inf, None) for one, unit in never]


def _over_shapes(back: Background, tried: Tried, prior: float, explained: FloatArray) -> tuple[float, Tried]:
    """Size that is seen as often as promised over all shapes of the effect, and it in a shape that asks so much.

    The shape that is likeliest where nothing is there is the one by which the effect shows best.
    Shapes of which the runs have hardly anything are not asked about: no log that stays half full tells of a loop that
    is wide near empty alone.
    """
    shapes = [each for each in tried.shapes if isinstance(each, Linear)]
    if not shapes or isinstance(tried.shape, Moving):
        return smallest_shown(back, tried, prior, explained), tried
    every = [replace(tried, shape=each, columns=each.columns) for each in shapes]
    columns = [each.columns @ first_direction(each)[0] for each in every]
    makes = np.linalg.norm(columns, axis=1)
    kept = np.flatnonzero(makes >= _HARDLY * makes.max())
    lines = [_line(back, every[k], columns[k], prior, explained) for k in kept]
    alone = np.array([line.shown() for line in lines])
    size = float(alone.max())
    if size > alone.min():
        # All of them at once show by the least and the most that one of them asks, or by something in between.
        size = _least_of(lambda at: float(np.mean([line.chance(at) for line in lines])) >= THRESHOLDS.power, alone)
    near = np.where(alone <= size, alone, -np.inf)
    return size, every[int(kept[int(np.argmax(near))])]


def _least_of(enough: Callable[[float], bool], sizes: FloatArray) -> float:
    """The least size that is enough, no less than the least and no more than the largest of some; infinite: none is."""
    low, high = np.log(sizes.min()), np.log(min(sizes.max(), sizes.min() * _SEARCH[1]))
    if not np.isfinite(low) or (np.isinf(sizes).any() and not enough(float(np.exp(high)))):
        return np.inf
    while high - low > _CLOSE:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if enough(float(np.exp(middle))) else (middle, high)
    return float(np.exp(high))


@dataclass(frozen=True)
class _Line:
    """What one unit of an effect's first figure makes, as the evidence sees it.

    Attributes
    ----------
    usual : size of a usual effect, in that unit
    inner, nothing : for each scale of the error, its squared length by the root, and the logarithm of nothing
    needed : gain of the logarithm from which it is told
    """

    usual: float
    inner: tuple[float, ...]
    nothing: tuple[float, ...]
    needed: float

    def surplus(self, size: float, unlucky: float) -> float:
        """Gain over what is needed where errors hide a usual size by so many standard deviations."""
        at = THRESHOLDS
        without, with_it = [], []
        for a, base in zip(self.inner, self.nothing, strict=True):
            across = size * a - unlucky * np.sqrt(a)
            left = base - 0.5 * size**2 * a + size * unlucky * np.sqrt(a)
            without.append(left)
            for wide in at.sizes:
                grown = 1.0 + wide**2 * a
                with_it.append(left + 0.5 * across**2 * wide**2 / grown - 0.5 * np.log(grown * len(at.sizes) ** 2))
        return log_sum(with_it) - log_sum(without) - self.needed

    def shown(self) -> float:
        """The smallest size, in the unit, that is told as often as promised; infinite: none is."""
        unlucky = float(ndtri(THRESHOLDS.power))
        low, high = np.log(_SEARCH)
        if self.surplus(float(np.exp(high)), unlucky) < 0.0:
            return np.inf
        while high - low > _CLOSE:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self.surplus(float(np.exp(middle)), unlucky) > 0.0 else (middle, high)
        return self.usual * float(np.exp(high))

    def chance(self, size: float) -> float:
        """How often a size in the unit is told."""
        low, high = _UNLUCKY
        while high - low > _CLOSE:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.surplus(size / self.usual, middle) > 0.0 else (low, middle)
        return float(ndtr(low))


def _line(back: Background, tried: Tried, column: FloatArray, prior: float, explained: FloatArray) -> _Line:
    """Of the (N,) that one unit of an effect's first figure makes."""
    at = THRESHOLDS
    usual = 1.0 / max(float(np.linalg.norm(first_direction(tried)[0])), 1e-300)
    inner, nothing = [], []
    whites = back.whites(np.column_stack([column * usual, back.error - explained]), at.scales)
    for scale, weight, white in zip(at.scales, at.scale_weights, whites, strict=True):
        inner.append(float(white[:, 0] @ white[:, 0]))
        base = float(np.log(weight)) - back.log_root(scale)
        nothing.append(base - 0.5 * float(white[:, 1] @ white[:, 1]))
    needed = float(np.log(at.nothing * (1.0 / at.claim - 1.0) / prior)) / back.tempering
    return _Line(usual, tuple(inner), tuple(nothing), needed)


def _along(back: Background, tried: Tried, column: FloatArray, prior: float, explained: FloatArray) -> float:
    """The smallest size of an effect that makes (N,) of one unit of its first figure."""
    return _line(back, tried, column, prior, explained).shown()
