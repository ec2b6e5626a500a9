"""Simpler explanations before richer ones: what leaves less unexplained with fewer causes, or with a special case."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.likelihood.background import Background, log_sum
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.diagnosis.likelihood.tried import Tried, together

# Square of an error below which there is none.
_LEAST_V2 = 1e-12


def _left_V(back: Background, contribution: FloatArray, n_voltage: int) -> float:
    """Root mean square of the voltage's error that an explanation leaves, all that is open left aside."""
    return float(np.sqrt(np.mean((back.error[:n_voltage] - contribution[:n_voltage]) ** 2)))


def _left_by_start_V(back: Background, contribution: FloatArray, n_voltage: int) -> float:
    """The same, but for what went before the log: an overvoltage's first minutes may pass for it."""
    left = back.error[:n_voltage] - contribution[:n_voltage]
    if back.starts is not None and back.starts.size:
        starts, usual_V2 = back.starts[:n_voltage], float(np.mean(back.error[:n_voltage] ** 2))
        information = starts.T @ starts + max(usual_V2, _LEAST_V2) * np.eye(starts.shape[1])
        left = left - starts @ np.linalg.solve(information, starts.T @ left)
    return float(np.sqrt(np.mean(left**2)))


def _left_K(back: Background, contribution: FloatArray, n_voltage: int) -> float:
    """The same of the temperature; 0 where it is not looked at."""
    left = (back.error - contribution)[n_voltage:]
    return float(np.sqrt(np.mean(left**2))) if len(left) else 0.0


def _most_K(back: Background, n_voltage: int) -> float:
    """Error of the temperature that an explanation may leave: what nothing does, or the heat balance usually does."""
    usual_K2 = np.diag(back.elsewhere)[n_voltage:]
    usual_K = float(np.sqrt(np.mean(usual_K2))) if len(usual_K2) else 0.0
    return THRESHOLDS.worse * max(_left_K(back, np.zeros(len(back.error)), n_voltage), usual_K)


def worsens(back: Background, contribution: FloatArray, n_voltage: int) -> bool:
    """Whether an explanation raises the error of the voltage, or of the temperature, instead of lowering it."""
    before_V = _left_V(back, np.zeros(len(back.error)), n_voltage)
    return _left_V(back, contribution, n_voltage) > THRESHOLDS.worse * before_V or _left_K(
        back, contribution, n_voltage
    ) > _most_K(back, n_voltage)


class Simpler:
    """Whether an explanation leaves clearly more error of the voltage than nothing, or than a simpler one within it.

    Or more of the temperature than nothing, beyond what the heat balance is usually off by.

    Simpler are one of two effects alone, and a special case in the place of what contains it; each only where the runs
    ask for it by itself.

    Parameters
    ----------
    back : error and covariance
    tried : every effect
    n_voltage : points of the voltage, the first ones
    """

    def __init__(self, back: Background, tried: list[Tried], n_voltage: int) -> None:
        self._back, self._n_voltage, self._tried = back, n_voltage, tried
        self._nothing_V = _left_V(back, np.zeros(len(back.error)), n_voltage)
        self._alone_V = [_left_V(back, each.contribution, n_voltage) for each in tried]
        self._alone_K = [_left_K(back, each.contribution, n_voltage) for each in tried]
        self._most_K = _most_K(back, n_voltage)
        self._asked = [each.weighed.log_likelihood >= THRESHOLDS.asked for each in tried]
        self._number = {each.effect.name: i for i, each in enumerate(tried)}

    def special(self, i: int) -> list[int]:
        """Numbers of the special cases of an effect that the runs ask for by themselves.

        What bends the curve by losing capacity has the plain loss as one: where that leaves less, nothing was bent.
        """
        names = list(self._tried[i].effect.contains)
        if self._tried[i].effect.causes:
            names += [each.effect.name for each in self._tried if each.effect.life == "capacity"]
        found = [self._number[name] for name in names if name in self._number]
        return [each for each in found if self._asked[each]]

    def single(self, i: int) -> bool:
        """Of one effect."""
        if self._alone_K[i] > self._most_K:
            return True
        if self._warms[i] or self._alone_V[i] <= THRESHOLDS.worse * min(self._nothing_V, *self._least_V(i)):
            return False
        return not self._tried[i].effect.overpotential or self._by_start(i)

    def _by_start(self, i: int) -> bool:
        """The same of an overvoltage, what it and its special cases share with the start left aside."""
        parts = [self._tried[each].contribution for each in (i, *self.special(i))]
        nothing = np.zeros(len(self._back.error))
        own_V, *least_V = (_left_by_start_V(self._back, each, self._n_voltage) for each in (*parts, nothing))
        return own_V > THRESHOLDS.worse * min(least_V)

    def pair(self, i: int, j: int, part: FloatArray) -> bool:
        """Of two at once, which stand for (N,) `part`."""
        if _left_K(self._back, part, self._n_voltage) > self._most_K:
            return True
        most_V = _left_V(self._back, part, self._n_voltage) / THRESHOLDS.worse
        if warm_V := [self._alone_V[each] for each in (i, j) if self._warms[each]]:
            return most_V > max(warm_V)
        if most_V > min(self._nothing_V, *self._least_V(i), *self._least_V(j)):
            return True
        inner = [(each, j) for each in self.special(i)] + [(i, each) for each in self.special(j)]
        return any(most_V > self._both_V(*each) for each in inner if each[0] != each[1])

    @cached_property
    def _warms(self) -> list[bool]:
        """Whether the temperature alone asks for each effect: it is there, whatever hides what its voltage adds."""
        seen = self._n_voltage < len(self._back.error)
        return [seen and each.effect.own_heat and self._warmth(each) >= THRESHOLDS.asked for each in self._tried]

    def _warmth(self, one: Tried) -> float:
        """Gain of the logarithm by the temperature alone."""
        own = slice(self._n_voltage, None)
        return self._warm.weigh(one.columns[own], None if one.moved is None else one.moved[own]).log_likelihood

    @cached_property
    def _warm(self) -> Background:
        return self._back.part(slice(self._n_voltage, None))

    def _least_V(self, i: int) -> list[float]:
        own = [self._alone_V[i]] if self._asked[i] else []
        return [np.inf, *own, *(self._alone_V[each] for each in self.special(i))]

    def _both_V(self, i: int, j: int) -> float:
        both = [self._tried[i], self._tried[j]]
        return _left_V(self._back, together(self._back, both)[1], self._n_voltage)


def shares(tried: list[Tried]) -> FloatArray:
    """(effects,) prior weight of each effect beside one with a single shape."""
    return np.array([each.effect.expected.share for each in tried])


def simplest_first(
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
                if not np.isfinite(joint_logs[both]):
                    continue
                joint_logs[both] = max(joint_logs[both], joint_logs[free] + part)
            joint_logs[free] += kept


def price_of_shape(
    tried: list[Tried], couples: list[tuple[int, int]], single_logs: FloatArray, joint_logs: FloatArray
) -> None:
    """Let a free shape over the state of charge pay for what a constant of the same kind explains as well.

    A constant that has become a curve is two changes, so that the shape is weighed as a second one beside the constant;
    it never pays more than the constant explains.

    Parameters
    ----------
    tried, couples, single_logs, joint_logs : as in `simplest_first`
    """
    at, share = THRESHOLDS, shares(tried)
    gains = {each.effect.name: each.weighed.log_likelihood for each in tried}
    second = float(np.log(share.sum() * (1.0 - at.nothing - at.unknown - at.pairs) / at.pairs))
    for e, general in enumerate(tried):
        if general.effect.local is None or general.effect.absorbed:
            continue
        known = max((gains.get(name, 0.0) for name in general.effect.contains), default=0.0)
        price = min(second, at.tempering * max(known, 0.0))
        single_logs[e] -= price
        joint_logs[[c for c, couple in enumerate(couples) if e in couple]] -= price
