"""From a run to probabilities of what has changed: nothing, or any of capacity, resistance and curve together.

Each is held against the same run as a Gaussian likelihood in which what has changed may be large and all else differs
as it does from run to run; a change that is not needed makes a run less likely (Kass and Raftery, J. Am. Stat. Assoc.
90, 1995, on Bayes factors).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from models.data.timeseries import FloatArray
from models.diagnosis.trend.loss.losses import WAYS, Loss
from models.diagnosis.trend.settings import SETTINGS, USUAL, Sizes
from models.diagnosis.trend.weights.latent import resistances, root
from models.diagnosis.trend.weights.sizes import (
    CAPACITY,
    EVERY,
    Changes,
    cause_largest,
    every_size,
    largest,
    sizes_of,
)
from models.diagnosis.trend.weights.summed import Summed, Sums

# Scales of the error whose likelihood's logarithm is that much lower than the best say nothing.
_UNLIKELY = 9.0


@dataclass(frozen=True)
class Held:
    """One explanation held against a run.

    Attributes
    ----------
    changes : what may be large
    log : logarithm of its likelihood
    mean, covariance : (COUNT,), (COUNT, COUNT) of the weights
    resistance_Ohm, resistance_std_Ohm : (n,) of the first moment
    """

    changes: tuple[str, ...]
    log: float
    mean: FloatArray
    covariance: FloatArray
    resistance_Ohm: FloatArray
    resistance_std_Ohm: FloatArray


@dataclass(frozen=True)
class Chances:
    """Probabilities.

    Attributes
    ----------
    nothing, unknown : of nothing new, and of something that none of the changes stands for
    of : of each set of changes
    way : of each way to lose a capacity, if one is lost, by its number; -1: of none of those that are known
    """

    nothing: float
    unknown: float
    of: dict[Changes, float]
    way: dict[int, float] = field(default_factory=dict)

    def that(self, change: str) -> float:
        """Probability that one of the changes is there, alone or with others."""
        return sum(p for each, p in self.of.items() if change in each)


@dataclass(frozen=True)
class Caused:
    """What a run says of one way to lose a capacity.

    Attributes
    ----------
    logs : logarithm of its likelihood, by what has changed beside it
    share, share_std : that is lost
    loss : the likeliest one
    about : what is kept of the run about that
    matched_V : what half-cell curves leave of that of the fresh cell
    """

    logs: dict[Changes, float]
    share: float
    share_std: float
    loss: Loss
    about: Summed
    matched_V: float


def chances(fresh: Summed, now: Summed, causes: dict[int, Caused]) -> Chances:
    """Weigh everything against everything.

    Parameters
    ----------
    fresh, now : the run about the capacity as it was, and about that which it asks for
    causes : ways to lose a capacity, by their numbers
    """
    at, logs = SETTINGS, {}
    for each in EVERY:
        about = now if CAPACITY in each else fresh
        known = [(sums, w) for sums, w in zip(about.sums, at.weights, strict=True) if w > 0.0]
        spreads = np.array([root(sizes_of(sizes, now.change)) for sizes in every_size(each)])
        several = np.concatenate([np.log(w) + logs_of(sums, spreads) for sums, w in known])
        logs[each] = log_sum(several) - float(np.log(len(spreads)))
    by_way = _by_way(logs, causes)
    logs |= {each: log_sum(np.array(list(own.values()))) for each, own in by_way.items()}
    own = root(USUAL)
    beyond = [log_of(sums, own) for sums in fresh.sums if sums.scale in at.unknown_scales]
    unknown = log_sum(beyond) - float(np.log(len(beyond)))
    weights = {each: at.more ** len(each) for each in EVERY if each}
    share = (1.0 - at.nothing - at.unknown) / sum(weights.values())
    prior = {(): at.nothing} | {each: share * w for each, w in weights.items()}
    posterior = [np.log(prior[each]) + logs[each] for each in EVERY]
    posterior.append(np.log(at.unknown) + unknown)
    p = np.exp(np.array(posterior) - log_sum(posterior))
    of = dict(zip(EVERY[1:], p[1:-1].tolist(), strict=True))
    return Chances(float(p[0]), float(p[-1]), of, _ways(by_way, prior))


def _by_way(logs: dict[Changes, float], causes: dict[int, Caused]) -> dict[Changes, dict[int, float]]:
    """Logarithms of likelihood and prior of every way, -1 for none, by the sets of changes with a capacity."""
    plain = np.log(SETTINGS.plain) if causes else 0.0
    share = {way: np.log((1.0 - SETTINGS.plain) * WAYS[way].weight) for way in causes}
    out = {}
    for each in (one for one in logs if CAPACITY in one):
        beside = tuple(one for one in each if one != CAPACITY)
        own = {way: found.logs[beside] + float(share[way]) for way, found in causes.items()}
        out[each] = {-1: logs[each] + float(plain), **own}
    return out


def _ways(by_way: dict[Changes, dict[int, float]], prior: dict[Changes, float]) -> dict[int, float]:
    """Probability of every way if a capacity is lost, whatever has changed beside it."""
    ways = list(next(iter(by_way.values())))
    told = [log_sum([float(np.log(prior[each])) + own[way] for each, own in by_way.items()]) for way in ways]
    p = np.exp(np.array(told) - log_sum(told))
    return dict(zip(ways, p.tolist(), strict=True))


def log_of(sums: Sums, spread: FloatArray) -> float:
    """Logarithm of the likelihood for one root of the covariance of the weights; see `logs_of`."""
    return float(logs_of(sums, spread[None])[0])


def logs_of(sums: Sums, spreads: FloatArray) -> FloatArray:
    """(k,) logarithms of the likelihood for (k, COUNT, COUNT) roots of the covariance of the weights.

    What is tempered is what the samples say, not how large a usual difference is: a change that is many times larger
    than those is none of them, however little is believed of the samples (Grünwald and van Ommen, Bayesian Analysis 12,
    2017, on such posteriors).
    """
    power, turned = SETTINGS.tempering, spreads.transpose(0, 2, 1)
    # All at once: of hundreds for a run the calls alone would take as long as the sums.
    whole = power * (turned @ sums.inner @ spreads) + np.eye(spreads.shape[2])
    lower = np.linalg.cholesky(whole)
    told = power * np.linalg.solve(lower, (turned @ sums.right)[:, :, None])[:, :, 0]
    gained = 0.5 * np.sum(told**2, axis=1) - np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
    return power * sums.log + gained


def held(about: Summed, changes: Changes, sizes: list[Sizes] | None = None) -> Held:
    """Weights and resistances where some things have changed, over their forms and all scales of the model's error.

    Parameters
    ----------
    about : the run about the capacity that it asks for
    changes : what may be large
    sizes : of all that differs, as likely; None: those of the changes
    """
    open_ones = sizes or [sizes_of(each, about.change) for each in largest(changes)]
    spreads = np.array([root(each) for each in open_ones])
    known = [(sums, w) for sums, w in zip(about.sums, SETTINGS.weights, strict=True) if w > 0.0]
    told = np.array([np.log(w) + logs_of(sums, spreads) for sums, w in known])
    likely = np.argwhere(told > told.max() - _UNLIKELY)
    every = [_one(about, changes, known[scale], spreads[form]) for scale, form in likely.tolist()]
    logs = np.array([each.log for each in every])
    return mixed(every, np.exp(logs - logs.max()), changes)


def held_beside(found: Caused, changes: Changes) -> Held:
    """The same beside a loss that is known with its curve; the capacity's weight has that of the loss in it.

    Parameters
    ----------
    found : the loss
    changes : what may be large, the capacity among them
    """
    beside = tuple(each for each in changes if each != CAPACITY)
    own = held(found.about, changes, cause_largest(beside, found.about.change, found.matched_V))
    mean = own.mean.copy()
    mean[0] += found.about.change
    return replace(own, mean=mean)


def mixed(every: list[Held], weights: FloatArray, changes: tuple[str, ...]) -> Held:
    """Several explanations together, each as likely as its weight says.

    Parameters
    ----------
    every, weights : explanations and (n,) how likely each is, up to a factor
    changes : what the whole is said to be
    """
    share = weights / weights.sum()
    means = np.array([each.mean for each in every])
    mean = share @ means
    away = means - mean
    covariance = np.tensordot(share, np.array([each.covariance for each in every]), axes=1)
    covariance += (share[:, None] * away).T @ away
    ohms = np.array([each.resistance_Ohm for each in every])
    variances = np.array([each.resistance_std_Ohm**2 for each in every])
    ohm = share @ ohms
    std = np.sqrt(np.maximum(share @ (variances + (ohms - ohm) ** 2), 1e-18))
    return Held(changes, log_sum(np.array([each.log for each in every])), mean, covariance, ohm, std)


def _one(about: Summed, changes: tuple[str, ...], scale: tuple[Sums, float], spread: FloatArray) -> Held:
    sums, weight = scale
    whole = spread.T @ sums.inner @ spread
    whole[np.diag_indices_from(whole)] += 1.0
    factor = cho_factor(whole, lower=True, check_finite=False)
    covariance = spread @ cho_solve(factor, spread.T, check_finite=False)
    mean = covariance @ sums.right
    own = spread.T @ sums.right
    log = sums.log + 0.5 * float(own @ cho_solve(factor, own)) - float(np.sum(np.log(np.diag(factor[0]))))
    turn = resistances(about.fresh_Ohm, about.usual_Ohm, about.typical_Ohm)
    through = turn - sums.across_columns
    ohm = about.mean_Ohm + sums.across_error + through @ mean
    variance = about.known + sums.scale**2 * about.open - sums.across
    variance = variance + np.einsum("nk,kl,nl->n", through, covariance, through)
    return Held(changes, log + float(np.log(weight)), mean, covariance, ohm, np.sqrt(np.maximum(variance, 1e-18)))


def log_sum(logs: list[float] | FloatArray) -> float:
    """Logarithm of the sum of what logarithms stand for."""
    values = np.asarray(logs, dtype=np.float64)
    most = float(values.max())
    return most + float(np.log(np.sum(np.exp(values - most))))
