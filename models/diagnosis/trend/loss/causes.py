"""What a lost capacity comes from: each cause of `losses` held against a run.

A run is held against all shares at once, in the same Gaussian likelihood as everything else: what differs from run to
run anyway is open, and so are resistance and curve where they are said to have changed, too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from models.data.timeseries import FloatArray
from models.diagnosis.trend.loss.losses import SHARES, WAYS, Loss, losses_of
from models.diagnosis.trend.prior import About, Given, off
from models.diagnosis.trend.settings import SETTINGS, Sizes
from models.diagnosis.trend.weights.latent import DIFFERENT, root
from models.diagnosis.trend.weights.sizes import CAPACITY, EVERY, Changes, cause_sizes
from models.diagnosis.trend.weights.summed import Sums, Told, White, in_units_of
from models.diagnosis.trend.weights.weighing import Caused, log_sum
from models.effects.bent_curve import slow_rate
from models.effects.half_cells import apart, own_curve
from models.effects.view import View

# By how much the capacity under load is another than between the same ends at rest, relative, and how often: most
# cut-offs lie where any curve is steep, at some a particle's surface is empty while the mean is not.
_LOADED_STD, _LOADED_SHARE = np.array([0.005, 0.02]), np.array([0.7, 0.3])
# What can be beside a cause.
_BESIDE: tuple[Changes, ...] = tuple(each for each in EVERY if CAPACITY not in each)


def caused(given: Given, now: About, other: tuple[Given, About] | None = None) -> dict[int, Caused]:
    """Hold each way to lose something against a run, by its number; none where the cell cannot be taken apart.

    Losses of electrodes that do not make the cell's own curve tell nothing of it, and are not held against a run.

    Parameters
    ----------
    given : run
    now : about the capacity that it asks for
    other : the same of another run of the cell in the same state, that is held against them with it
    """
    curve = own_curve(given.known.cell)
    if curve is None or not apart(curve).published:
        return {}
    away = SETTINGS.near_ends if len(given.ends.index) else SETTINGS.near_none
    near = [each for each in losses_of(curve) if abs(each.change - now.change) <= away]
    if not near:
        return {}
    error = _errors(given, now, near)
    told = None if other is None else _told_by(*other, near, now.usual_Ohm)
    scales = [_Scale.of(now, k, error, told) for k, w in enumerate(SETTINGS.weights) if w > 0.0]
    matched_V = apart(curve).left_V
    chance = np.log([each.chance for each in near])
    if len(given.ends.index):
        chance += _as_loaded(np.array([each.change for each in near]) - now.change)
    logs = {each: chance + _logs(scales, cause_sizes(each, now.change, matched_V)) for each in _BESIDE}
    out = {}
    for way in range(len(WAYS)):
        own = np.array([k for k, each in enumerate(near) if each.way == way], dtype=np.int64)
        if len(own):
            by_set, mean, std, best = _weighed([near[k] for k in own], {name: each[own] for name, each in logs.items()})
            loss = near[own[best]]
            about = replace(now.summed, change=_change(given, now, loss), sums=_about(now, error[:, own[best]]))
            if other is not None:
                its = _about(other[1], _errors(*other, [loss])[:, 0])
                about = about.beside(replace(other[1].summed, change=_change(*other, loss), sums=its), DIFFERENT)
            out[way] = Caused(by_set, mean, std, loss, about, matched_V)
    return out


def _errors(given: Given, now: About, losses: list[Loss]) -> FloatArray:
    """(N, M) by how much a run differs from a cell with each loss."""
    rate = slow_rate(View(given.known.cell, given.run, given.soc, given.index))
    charged = given.run.charge_Ah[given.index] / given.known.cell.capacity_Ah
    out = np.empty((len(now.error), len(losses)))
    for k, each in enumerate(losses):
        change = _change(given, now, each)
        out[:, k] = off(given, now.inputs, change) - now.mean
        counted = given.soc + charged / (1.0 + change)
        out[: now.n_voltage, k] -= each.bent.voltage_V(counted, rate, change)
    return out


def _as_loaded(off: FloatArray) -> FloatArray:
    """(M,) logarithm of how likely it is that a loss's capacity at rest is that much above the one under load."""
    densities = _LOADED_SHARE / _LOADED_STD * np.exp(-0.5 * (off[:, None] / _LOADED_STD) ** 2)
    return np.log(densities.sum(axis=1) / (_LOADED_SHARE / _LOADED_STD).sum())


def _change(given: Given, now: About, loss: Loss) -> float:
    """Of the capacity that a run counts on beside a loss: its own, where it has an end.

    A discharge ends by its voltage under load, and not where the cell would rest empty: full is what both share.
    """
    return now.change if len(given.ends.index) else loss.change


@dataclass(frozen=True)
class _Scale:
    """What is told of weights and losses, where the model's error elsewhere is of one scale.

    Attributes
    ----------
    weight : probability of that scale
    inner, right, log : (COUNT, COUNT), (COUNT, M), (M,) as in `Sums`, for each loss
    """

    weight: float
    inner: FloatArray
    right: FloatArray
    log: FloatArray

    @classmethod
    def of(cls, now: About, k: int, error: FloatArray, told: list[Told] | None) -> _Scale:
        inner, right, log = _against(now.white[k], error)
        if told is not None:
            inner, right, log = inner + told[k].inner, right + told[k].right, log + told[k].log
        return cls(SETTINGS.weights[k], inner, right, log)


def _against(white: White, error: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Inner products of the columns, theirs with (N, M) errors, and logarithms of the likelihood of these."""
    own = solve_triangular(white.lower, error, lower=True, check_finite=False)
    log = -np.sum(np.log(np.diag(white.lower))) - 0.5 * np.sum(own**2, axis=0)
    return white.sums.inner, white.columns.T @ own, log


def _told_by(given: Given, now: About, losses: list[Loss], usual_Ohm: float) -> list[Told]:
    """What another run tells of each loss, one for each scale; in units of a resistance."""
    error = _errors(given, now, losses)
    turn = in_units_of(usual_Ohm, now.usual_Ohm)
    return [Told.of(*_against(white, error), turn, DIFFERENT) for white in now.white]


def _logs(scales: list[_Scale], sizes: list[Sizes]) -> FloatArray:
    """(M,) logarithm of the likelihood of each loss with what else may differ, in each of these sizes as likely."""
    every, power = [], SETTINGS.tempering
    for scale in scales:
        for size in sizes:
            spread = root(size)
            whole = power * (spread.T @ scale.inner @ spread)
            whole[np.diag_indices_from(whole)] += 1.0
            lower = np.linalg.cholesky(whole)
            turned = power * solve_triangular(lower, spread.T @ scale.right, lower=True, check_finite=False)
            gained = 0.5 * np.sum(turned**2, axis=0) - np.sum(np.log(np.diag(lower)))
            every.append(power * scale.log + gained + np.log(scale.weight / len(sizes)))
    return np.logaddexp.reduce(np.array(every), axis=0)


def _weighed(losses: list[Loss], logs: dict[Changes, FloatArray]) -> tuple[dict[Changes, float], float, float, int]:
    """Logarithm of the likelihood of one way, the share that is lost with its standard deviation, the best loss."""
    whole = np.logaddexp.reduce(np.array(list(logs.values())), axis=0)
    chance = np.exp(whole - whole.max())
    chance /= chance.sum()
    shares = np.array([each.share for each in losses])
    mean = float(chance @ shares)
    std = float(np.sqrt(chance @ (shares - mean) ** 2 + SETTINGS.sharp**2))
    told = {name: log_sum(each) - float(np.log(len(SHARES))) for name, each in logs.items()}
    return told, mean, std, int(np.argmax(whole))


def _about(now: About, error: FloatArray) -> tuple[Sums, ...]:
    """Sums of a run about a loss, one for each scale."""
    out = []
    for white in now.white:
        own = solve_triangular(white.lower, error, lower=True, check_finite=False)
        log = -float(np.sum(np.log(np.diag(white.lower)))) - 0.5 * float(own @ own)
        out.append(replace(white.sums, log=log, right=white.columns.T @ own, across_error=white.across.T @ own))
    return tuple(out)
