"""From a run to probabilities of what has changed: nothing, or any of capacity, resistance and curve together.

Each is held against the same run as a Gaussian likelihood in which what has changed may be large and all else differs
as it does from run to run; a change that is not needed makes a run less likely (Kass and Raftery, J. Am. Stat. Assoc.
90, 1995, on Bayes factors).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from models.data.timeseries import FloatArray
from models.diagnosis.trend.latent import resistances, root
from models.diagnosis.trend.prior import About, White
from models.diagnosis.trend.settings import CHANGED, SETTINGS, USUAL, Sizes

CAPACITY, RESISTANCE, CURVE = "capacity", "resistance", "curve"
CHANGES = (CAPACITY, RESISTANCE, CURVE)
EVERY: tuple[tuple[str, ...], ...] = tuple(each for n in range(len(CHANGES) + 1) for each in combinations(CHANGES, n))


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
    """

    nothing: float
    unknown: float
    of: dict[tuple[str, ...], float]

    def that(self, change: str) -> float:
        """Probability that one of the changes is there, alone or with others."""
        return sum(p for each, p in self.of.items() if change in each)


def sizes_of(changes: tuple[str, ...], size: float, capacity: float) -> Sizes:
    """What may differ where some of it has changed.

    Parameters
    ----------
    changes : that are there
    size : of them, in units of the largest that is usual
    capacity : how much of it is lost: by a part of that electrodes have slipped
    """
    own = USUAL
    if CAPACITY in changes:
        slip = float(np.hypot(USUAL.slip, SETTINGS.slip_of_capacity * capacity))
        own = replace(own, capacity=size * CHANGED.capacity, slip=slip)
    if RESISTANCE in changes:
        own = replace(own, resistance=size * CHANGED.resistance, slower=size * CHANGED.slower)
    if CURVE in changes:
        slip = float(np.hypot(own.slip, size * CHANGED.slip))
        own = replace(
            own, curve_V=size * CHANGED.curve_V, slip=slip, shift=size * CHANGED.shift, loop_V=size * CHANGED.loop_V
        )
    return own


def chances(fresh: About, now: About) -> Chances:
    """Weigh everything against everything.

    Parameters
    ----------
    fresh, now : the run about the capacity as it was, and about that which it asks for
    """
    at, logs = SETTINGS, {}
    for each in EVERY:
        about = now if CAPACITY in each else fresh
        several = [
            np.log(w) - np.log(len(at.sizes)) + log_of(white, root(sizes_of(each, size, now.change)))
            for size in at.sizes
            for white, w in zip(about.white, at.weights, strict=True)
            if w > 0.0
        ]
        logs[each] = _log_sum(several) if each else _log_sum(several[: len(several) // len(at.sizes)]) + np.log(2.0)
    own = root(USUAL)
    beyond = [log_of(white, own) for white in fresh.white if white.scale in at.unknown_scales]
    unknown = _log_sum(beyond) - float(np.log(len(beyond)))
    weights = {each: at.more ** len(each) for each in EVERY if each}
    share = (1.0 - at.nothing - at.unknown) / sum(weights.values())
    prior = {(): at.nothing} | {each: share * w for each, w in weights.items()}
    posterior = [np.log(prior[each]) + at.tempering * logs[each] for each in EVERY]
    posterior.append(np.log(at.unknown) + at.tempering * unknown)
    p = np.exp(np.array(posterior) - _log_sum(posterior))
    return Chances(float(p[0]), float(p[-1]), dict(zip(EVERY[1:], p[1:-1].tolist(), strict=True)))


def log_of(white: White, spread: FloatArray) -> float:
    """Logarithm of the likelihood for a root of the covariance of the weights."""
    inner, right = white.products
    whole = spread.T @ inner @ spread
    whole[np.diag_indices_from(whole)] += 1.0
    lower = np.linalg.cholesky(whole)
    turned = np.linalg.solve(lower, spread.T @ right)
    return white.log + 0.5 * float(turned @ turned) - float(np.sum(np.log(np.diag(lower))))


def held(about: About, changes: tuple[str, ...]) -> Held:
    """Weights and resistances where some things have changed, over all scales of the model's error.

    Parameters
    ----------
    about : the run about the capacity that it asks for
    changes : what may be large
    """
    spread = root(sizes_of(changes, max(SETTINGS.sizes), about.change))
    every = [
        _one(about, changes, (white, w), spread)
        for white, w in zip(about.white, SETTINGS.weights, strict=True)
        if w > 0.0
    ]
    logs = np.array([each.log for each in every])
    return mixed(every, np.exp(logs - logs.max()), changes)


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
    return Held(changes, _log_sum(np.array([each.log for each in every])), mean, covariance, ohm, std)


def _one(about: About, changes: tuple[str, ...], scale: tuple[White, float], spread: FloatArray) -> Held:
    white, weight = scale
    inner, right = white.products
    whole = spread.T @ inner @ spread
    whole[np.diag_indices_from(whole)] += 1.0
    factor = cho_factor(whole, lower=True, check_finite=False)
    covariance = spread @ cho_solve(factor, spread.T, check_finite=False)
    mean = covariance @ right
    own = spread.T @ right
    log = white.log + 0.5 * float(own @ cho_solve(factor, own)) - float(np.sum(np.log(np.diag(factor[0]))))
    fresh, across = about.fresh, white.across
    turn = resistances(about.fresh_Ohm, about.usual_Ohm)
    ohm = fresh.mean_Ohm + turn @ mean + across.T @ (white.error - white.columns @ mean)
    through = turn - across.T @ white.columns
    variance = fresh.known + white.scale**2 * fresh.open - np.sum(across**2, axis=0)
    variance = variance + np.einsum("nk,kl,nl->n", through, covariance, through)
    return Held(changes, log + float(np.log(weight)), mean, covariance, ohm, np.sqrt(np.maximum(variance, 1e-18)))


def _log_sum(logs: list[float] | FloatArray) -> float:
    values = np.asarray(logs, dtype=np.float64)
    most = float(values.max())
    return most + float(np.log(np.sum(np.exp(values - most))))
