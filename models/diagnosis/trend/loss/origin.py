"""What a lost capacity comes from, by the whole series: its name, its share, and what is left for a moved curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.evidence.parameters import Value
from models.diagnosis.trend.estimate import Weighed
from models.diagnosis.trend.loss.losses import CAUSES, WAYS
from models.diagnosis.trend.settings import SETTINGS
from models.diagnosis.trend.weights.sizes import CAPACITY, CURVE, Changes
from models.effects import Effect, effects
from models.effects.half_cells import half_cells


@dataclass(frozen=True)
class Origin:
    """What a lost capacity comes from.

    Attributes
    ----------
    cause : name of the cause; "": it is not told, or several
    way : likeliest way of it, by its number; -1: none
    chance : probability of the cause
    values : share that is lost
    chances : of each cause, by what a person calls it
    """

    cause: str = ""
    way: int = -1
    chance: float = 0.0
    values: dict[str, Value] = field(default_factory=dict)
    chances: dict[str, float] = field(default_factory=dict)

    @property
    def effect(self) -> str:
        """Name of the effect that stands for it."""
        return _effect(self.cause).name

    def beside(self, weighed: Weighed, changes: Changes) -> Changes:
        """What has changed: a loss that is known brings a curve of its own, beside which none need have moved."""
        if not self.cause or CURVE not in changes:
            return changes
        logs = weighed.causes[self.way].logs
        with_it = tuple(each for each in changes if each != CAPACITY)
        without = tuple(each for each in with_it if each != CURVE)
        gained = logs[with_it] - logs[without] + np.log(SETTINGS.more)
        return changes if gained > 0.0 else tuple(each for each in changes if each != CURVE)


def origin_of(weighed: Weighed, changes: Changes, by_way: FloatArray | None, beside: Sequence[Weighed] = ()) -> Origin:
    """Find it.

    Parameters
    ----------
    weighed : the run
    changes : that it shows
    by_way : (ways + 1,) probability of each way by the whole series
    beside : other runs at the same place of the series, which saw the cell in the same state
    """
    electrodes = half_cells(weighed.given.known.cell)
    if by_way is None or CAPACITY not in changes or electrodes is None or not electrodes.published:
        return Origin()
    chances = {cause: float(sum(by_way[k] for k, way in enumerate(WAYS) if way.cause == cause)) for cause in CAUSES}
    called = {_effect(cause).name + _of(cause): p for cause, p in chances.items()}
    cause = max(chances, key=lambda each: chances[each])
    own = {k: float(by_way[k]) for k, way in enumerate(WAYS) if way.cause == cause and k in weighed.causes}
    if chances[cause] < (SETTINGS.cause if electrodes.sure else SETTINGS.cause_alike) or not own:
        return Origin(chances=called)
    way = max(own, key=lambda each: own[each])
    p = np.array(list(own.values())) / sum(own.values())
    share, std = _share([each for each in (weighed, *beside) if way in each.causes], way)
    away = np.array([weighed.causes[k].share for k in own]) - weighed.causes[way].share
    parameter = _effect(cause).parameters[0]
    value = Value(share, float(np.sqrt(std**2 + p @ away**2)), parameter.unit)
    return Origin(cause, way, chances[cause], {parameter.name + _of(cause): value}, called)


def _share(runs: list[Weighed], way: int) -> tuple[float, float]:
    """Share that is lost in a way by all runs that saw it, with the standard deviation of the surest one.

    What the runs are off by is the model's, not chance: several are no surer than one.
    """
    shares, stds = np.array([(each.causes[way].share, each.causes[way].share_std) for each in runs]).T
    weights = stds**-2.0
    mean = float(weights @ shares / weights.sum())
    return mean, float(np.sqrt(stds.min() ** 2 + weights @ (shares - mean) ** 2 / weights.sum()))


def _effect(cause: str) -> Effect:
    return next(each for each in effects().values() if cause in each.causes)


def _of(cause: str) -> str:
    """What the name of a share is followed by, where an effect has several causes."""
    return f" of the {cause} electrode" if len(_effect(cause).causes) > 1 else ""
