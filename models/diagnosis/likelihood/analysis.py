"""One call: judged runs against everything that is known of the training runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.known.thresholds import KNOWN
from models.diagnosis.likelihood.background import Background, Weighed
from models.diagnosis.likelihood.granted import granted, lacking
from models.diagnosis.likelihood.power import Power, power_of
from models.diagnosis.likelihood.shapes import Moving, shapes_of
from models.diagnosis.likelihood.sight import Sight, background, gain_of_start, look
from models.diagnosis.likelihood.sizes import averaged, doubt, widened
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.diagnosis.likelihood.tried import Tried, alike, once, stacked, together, try_shapes
from models.diagnosis.likelihood.verdict import Verdict, as_whole_loss, chances_of, in_other_explanations, judge
from models.effects import Effect
from models.effects.half_cells import half_cells
from models.effects.view import View


@dataclass(frozen=True)
class Analysis:
    """What judged runs say.

    Attributes
    ----------
    sight, back : the runs, and what they would be like with nothing new
    tried : every effect that they can show
    verdict : probabilities
    untold : effects that they may have, but do not tell from what any cell does: none of them is claimed
    absent : effects of which nothing can be in these runs
    """

    sight: Sight
    back: Background
    tried: tuple[Tried, ...]
    verdict: Verdict
    untold: tuple[Tried, ...] = ()
    absent: tuple[Effect, ...] = ()

    @cached_property
    def named(self) -> tuple[Tried, ...]:
        """The likeliest explanation: one effect, or two, the more needed first; none where nothing is said."""
        if not self.verdict.something:
            return ()
        likeliest, both = self._likeliest
        if self.verdict.unknown > likeliest:
            return ()
        # The more by itself one explains, the less the other could do without it.
        return tuple(sorted(both, key=lambda each: -each.weighed.log_likelihood))

    @cached_property
    def _likeliest(self) -> tuple[float, tuple[Tried, ...]]:
        """The likeliest of one effect and two, with its probability; two only where they are clearly more likely."""
        alone, two = self.verdict.single[:1], self.verdict.pairs[:1]
        best, *which = max([*alone, *two], key=lambda each: each[0] / (THRESHOLDS.two if len(each) > 2 else 1.0))
        return best, as_whole_loss(self.verdict, self.tried, which, electrodes=self.electrodes_known) or tuple(which)

    @cached_property
    def electrodes_known(self) -> bool:
        """Whether published curves are surely the cell's electrodes."""
        known = half_cells(self.sight.known.cell) if any(each.effect.causes for each in self.tried) else None
        return known is not None and known.sure

    def chance(self, one: Tried) -> float:
        """Probability that an effect is there, alone or with another."""
        alone = sum(p for p, each in self.verdict.single if each is one)
        return min(alone + sum(p for p, *both in self.verdict.pairs if any(each is one for each in both)), 1.0)

    @cached_property
    def sizes(self) -> dict[str, Weighed]:
        """Sizes of the named effects, found together and averaged over explanations, and of every other one alone."""
        factor = doubt(self.sight.known.elsewhere)
        every = (*self.tried, *self.untold)
        out = {each.effect.name: widened(self.back, each.weighed, *stacked((each,)), factor) for each in every}
        if len(self.named) > 1:
            both = widened(self.back, together(self.back, self.named)[0], *stacked(self.named), factor)
            first = 0
            for each in self.named:
                part = slice(first, first + each.columns.shape[1])
                out[each.effect.name] = Weighed(both.log_likelihood, both.mean[part], both.covariance[part, part])
                first = part.stop
        for each in self.named:
            others = in_other_explanations(self.back, self.verdict, each, self.named, factor)
            out[each.effect.name] = averaged(out[each.effect.name], self.verdict.chance(self.named), others)
        return out

    @property
    def rivals(self) -> tuple[Tried, ...]:
        """Effects that explain the runs nearly as well as the first that is named alone, or as two that are."""
        hidden = tuple(each for each in self.untold if each.effect.name in self.untold_chances)
        if len(self.named) != 1:
            return once(*hidden, *self._alone, *self._seems, *self._instead, *self._like_one, *self.one_curve)
        best, (named,) = self._likeliest
        singles = [(p, each) for p, each in self.verdict.single if each is not named]
        others = [each for p, each in singles if p * THRESHOLDS.rival >= best or alike(named, each)]
        name = named.effect
        twin = [each for _, each in singles if each.effect.name == name.twin and each not in others]
        curve = [each for each in self.one_curve if each not in (*twin, *others)]
        # Two that are as likely, yet not by enough to stand in the place of one.
        both = [each for p, *two in self.verdict.pairs if p >= best for each in two if each is not named]
        return once(*twin, *hidden, *others, *both, *curve)

    @cached_property
    def one_curve(self) -> tuple[Tried, ...]:
        """What else may have moved the curve that the named effects stand for, the free curve first where two do.

        Two errors that bend the same curve may be one cause that bends it so, and a curve that moved freely a cause
        whose own change is known in part only: a slipped electrode of another material, a loop that the runs went round
        once.
        """
        names = {each.effect.name for each in self.named}
        found: list[Tried] = []
        for general in self.tried:
            inside = {general.effect.name, *general.effect.contains}
            if general.effect.local is None or not general.effect.absorbed or not names or not names <= inside:
                continue
            free = general.weighed.log_likelihood
            if names == {general.effect.name} or (len(names) == 2 and free >= THRESHOLDS.asked):
                looks_alike = {each.effect.name for each in self.tried if general.effect.name in each.effect.like}
                inner = [each for each in self.tried if each.effect.name in (inside | looks_alike) - names]
                near = [each for each in inner if each.weighed.log_likelihood >= THRESHOLDS.one_curve * free]
                found += sorted(near, key=lambda each: -each.weighed.log_likelihood)
        return tuple(found)

    @cached_property
    def untold_chances(self) -> dict[str, float]:
        """Probability of each effect that is not claimed, where it would explain the runs nearly as well.

        What is named gives it no more than half of its own.
        """
        if not self.named:
            return {}
        best = self._likeliest[0]
        chances = chances_of(self.back, self.verdict, list(self.tried), list(self.untold), self.sight.n_voltage)
        near = {each.effect.name: p for each, p in zip(self.untold, chances.tolist(), strict=True)}
        return {name: best * p / (p + max(p, best)) for name, p in near.items() if p * THRESHOLDS.rival >= best}

    @property
    def _alone(self) -> list[Tried]:
        """Effects each of which would be nearly as likely as both that are named."""
        likely = [each for p, each in self.verdict.single if p * THRESHOLDS.rival >= self._likeliest[0]]
        return [each for each in likely if self.named and all(each is not one for one in self.named)]

    @property
    def _seems(self) -> tuple[Tried, ...]:
        """Effects that a named pair stands for where the cell's electrodes are not known."""
        names = frozenset(each.effect.name for each in self.named)
        return () if self.electrodes_known else tuple(each for each in self.tried if names in each.effect.seems)

    @property
    def _like_one(self) -> tuple[Tried, ...]:
        """Effects that most runs can hardly tell from one of a named pair, and that by themselves explain as much."""
        sure = [one for one in self.named if one.weighed.log_likelihood >= THRESHOLDS.asked]
        others = [each for each in self.tried if all(each is not one for one in self.named)]
        return tuple(each for each in others if any(alike(one, each) and alike(each, one) for one in sure))

    @property
    def _instead(self) -> tuple[Tried, ...]:
        """Effects with which one of a named pair would be as good in the place of the other, the likeliest first.

        What both pairs have is sure whatever causes of one loss stand beside it; which of them does is open.
        """
        if not self.named:
            return ()
        found = []
        for p, *both in self.verdict.pairs:
            other = [each for each in both if all(each is not one for one in self.named)]
            if p * THRESHOLDS.rival >= self._likeliest[0] and len(other) == 1:
                found += other
        return once(*found)

    @property
    def confidence(self) -> float:
        """Probability of what is named first: that it is there, alone or with another."""
        if not self.named:
            return self.verdict.unknown
        sure = max(self.chance(self.named[0]) - sum(self.untold_chances.values()), 0.0)
        if self.named[0].effect.life == "capacity" and not self.electrodes_known:
            # Whichever of its causes it is, that much is lost.
            causes = sum(self.chance(each) for each in self.tried if each.effect.causes)
            sure = max(sure, min(sure + causes, THRESHOLDS.sure_of_curve))
        return min(sure, THRESHOLDS.sure_of_curve) if self.one_curve or self._may_be_electrodes else sure

    @property
    def _may_be_electrodes(self) -> bool:
        """Whether a named free curve may be an electrode's whose own curve nobody knows, so that no shape is ruled out.

        Of nine curves named alone in class, three were lost material (seeds 901, 903, 911, 921); of two named beside
        another effect, both (5801).
        """
        if all(each.effect.local is None or not each.effect.absorbed for each in self.named):
            return False
        asked = any(each.effect.causes and each.weighed.log_likelihood >= THRESHOLDS.asked for each in self.tried)
        return asked and not self.electrodes_known

    @cached_property
    def explained(self) -> FloatArray:
        """(N,) what the named effects stand for."""
        out = np.zeros(len(self.back.error))
        for each in self.named:
            out += each.part(self.sizes[each.effect.name].mean)
        return out

    @cached_property
    def power(self) -> list[Power]:
        """Each effect with the smallest size that would have been seen."""
        return power_of(self.sight, self.back, self.tried, self.absent, self.untold, self.explained)

    @property
    def hides_best(self) -> tuple[str, ...]:
        """The three effects that could hide best: those that make most voltage at the smallest size that is seen."""
        asked = {each.effect.name for each in self.tried}
        told = [each for each in self.power if np.isfinite(each.size) or each.effect.name in asked]
        order = sorted(told, key=lambda each: -each.rms_V)
        return tuple(each.effect.name for each in order[:3])


def analyse(
    known: KnownRuns,
    runs: list[GridRun],
    soc: list[float],
    soc_std: list[float] | None,
    effects: list[Effect],
    *,
    same_start: bool = False,
    share: float = 1.0,
) -> Analysis:
    """Hold runs against what is known of the cell as it was.

    Parameters
    ----------
    known : of the training runs
    runs, soc : to be diagnosed, with their SoC at the start
    soc_std : its standard deviations; None: those of a careful statement
    effects : to be tried
    same_start : the known voltage was simulated from the same start; nothing of it is open
    share : of the usual number of samples that are looked at

    Raises
    ------
    ModelError
        No sample of the runs can be judged.
    """
    sight = look(known, runs, soc, share=share)
    std = None if same_start else soc_std or [KNOWN.start_soc] * len(runs)
    first = _held(sight, std, effects)
    moved = _moved_soc(first)
    if moved is None:
        return first
    # What an effect moves out of the trained state of charge would be held against it.
    try:
        closer = look(known, runs, soc, moved, share)
    except ModelError:
        return first
    enough = THRESHOLDS.share_kept * sight.share_inside <= closer.share_inside < sight.share_inside
    return _held(closer, std, effects) if enough else first


def _held(sight: Sight, soc_std: list[float] | None, effects: list[Effect]) -> Analysis:
    """Every effect held against the samples that are looked at."""
    shapes = {one.name: shapes_of(sight, one) for one in effects}
    shapes = {name: own for name, own in shapes.items() if own}
    back = background(sight, soc_std, np.hstack([granted(sight, shapes), lacking(sight, shapes)]))
    # What the runs do not tell from what any cell does may be there, but is not named.
    views = [run.points for run in sight.runs]
    every = [try_shapes(back, one, shapes[one.name]) for one in effects if one.name in shapes]
    told = [each.effect.tells(views) for each in every]
    tried = [each for each, own in zip(every, told, strict=True) if own]
    untold = tuple(each for each, own in zip(every, told, strict=True) if not own)
    absent = tuple(one for one in effects if one.name not in shapes)
    verdict = judge(back, tried, sight.n_voltage, gain_of_start(sight, back, soc_std))
    return Analysis(sight, back, tuple(tried), verdict, untold, absent)


def _moved_soc(analysis: Analysis) -> Callable[[View], FloatArray] | None:
    """The state of charge by the likeliest effect that moves it, where the runs ask for one."""
    movers = [
        each
        for each in analysis.tried
        if each.effect.expected.learned and isinstance(each.shape, Moving) and each.shape.soc is not None
    ]
    best = max(movers, key=lambda each: each.weighed.log_likelihood, default=None)
    if best is None or best.weighed.log_likelihood < THRESHOLDS.asked:
        return None
    assert isinstance(best.shape, Moving)
    soc_of, sizes = best.shape.soc, best.weighed.mean
    return None if soc_of is None else lambda view: soc_of(sizes, view)
