"""What a lost capacity comes from: each cause of `losses` held against a run.

A run is held against all shares at once, in the same Gaussian likelihood as everything else: what differs from run to
run anyway is open, and so are resistance and curve where they are said to have changed, too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import solve_triangular

from models.data.timeseries import FloatArray
from models.diagnosis.trend.latent import root
from models.diagnosis.trend.loss.losses import SHARES, WAYS, Loss, losses_of
from models.diagnosis.trend.prior import About, Given, off
from models.diagnosis.trend.settings import SETTINGS, Sizes
from models.diagnosis.trend.summed import Sums, White
from models.diagnosis.trend.weighing import CAPACITY, EVERY, Caused, Changes, cause_sizes, log_sum
from models.effects.half_cells import apart, own_curve

# What can be beside a cause.
_BESIDE: tuple[Changes, ...] = tuple(each for each in EVERY if CAPACITY not in each)


def caused(given: Given, now: About) -> dict[int, Caused]:
    """Hold each way to lose something against a run, by its number; none where the cell cannot be taken apart.

    Parameters
    ----------
    given : run
    now : about the capacity that it asks for
    """
    curve = own_curve(given.known.cell)
    away = SETTINGS.near_ends if len(given.ends.index) else SETTINGS.near_none
    near = [each for each in (() if curve is None else losses_of(curve)) if abs(each.change - now.change) <= away]
    if not near:
        return {}
    error = np.column_stack([_error(given, now, each) for each in near])
    scales = [(white, w) for white, w in zip(now.white, SETTINGS.weights, strict=True) if w > 0.0]
    whitened = [solve_triangular(white.lower, error, lower=True, check_finite=False) for white, _ in scales]
    matched_V = apart(curve).left_V if curve else 0.0
    chance = np.log([each.chance for each in near])
    logs = {each: chance + _logs(scales, whitened, cause_sizes(each, now.change, matched_V)) for each in _BESIDE}
    out = {}
    for way in range(len(WAYS)):
        own = np.array([k for k, each in enumerate(near) if each.way == way], dtype=np.int64)
        if len(own):
            told, mean, std, best = _told([near[k] for k in own], {name: each[own] for name, each in logs.items()})
            about = replace(now.summed, change=near[own[best]].change, sums=_about(now, error[:, own[best]]))
            out[way] = Caused(told, mean, std, near[own[best]], about, matched_V)
    return out


def _error(given: Given, now: About, loss: Loss) -> FloatArray:
    """(N,) by how much a run differs from a cell with a loss."""
    error = off(given, now.inputs, loss.change) - now.mean
    counted = given.soc + given.run.charge_Ah[given.index] / (given.known.cell.capacity_Ah * (1.0 + loss.change))
    error[: now.n_voltage] -= loss.curve_V(counted + now.inputs.surface)
    return error


def _logs(scales: list[tuple[White, float]], whitened: list[FloatArray], sizes: list[Sizes]) -> FloatArray:
    """(M,) logarithm of the likelihood of each loss with what else may differ, in each of these sizes as likely."""
    every, power = [], SETTINGS.tempering
    for (white, weight), error in zip(scales, whitened, strict=True):
        inner, right = white.sums.inner, white.columns.T @ error
        own = power * (-np.sum(np.log(np.diag(white.lower))) - 0.5 * np.sum(error**2, axis=0))
        for size in sizes:
            spread = root(size)
            whole = power * (spread.T @ inner @ spread)
            whole[np.diag_indices_from(whole)] += 1.0
            lower = np.linalg.cholesky(whole)
            turned = power * solve_triangular(lower, spread.T @ right, lower=True, check_finite=False)
            gained = 0.5 * np.sum(turned**2, axis=0) - np.sum(np.log(np.diag(lower)))
            every.append(own + gained + np.log(weight / len(sizes)))
    return np.logaddexp.reduce(np.array(every), axis=0)


def _told(losses: list[Loss], logs: dict[Changes, FloatArray]) -> tuple[dict[Changes, float], float, float, int]:
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
