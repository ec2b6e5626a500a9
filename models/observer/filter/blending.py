"""The local models of a network blended at a state of charge, from what can be worked out once beforehand.

A validity function is a product of kernels, one for each axis. Boxes are cut from one another, so that many share their
interval along an axis: its kernel is worked out once. Of hats only the two next knots count.
Called by `compiled.step` only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from models.network.compiled_network import FlatNetwork
from models.network.hats import hat_interval
from models.network.signals.loop_form import SOC
from models.network.signals.temperature_scale import inside_trained
from models.observer.filter.places import AXIS_ROWS, BLENDED_ROW, COMPILED, TILT_ROW, TILTED_ROW, VALIDITY_ROW

# A local model whose weight is below this share of the largest adds nothing that a double could hold.
_NEGLIGIBLE = 4e-18
# A kernel this much below the nearest one (in its exponent) is 0: tiny numbers are slow. Where all products are below
# what that leaves certain, far outside all boxes, they are formed relative to the largest.
_FAR = 200.0
_VANISHED = 1e-69
# Parameters are blended in groups of so many, side by side: that is what processors are good at.
GROUP = 4


class Prepared(NamedTuple):
    """Intervals of the partition along each axis, which of them each box has, and the parameters in groups."""

    centre: np.ndarray  # (axes, most) of the intervals
    per_width: np.ndarray  # (axes, most) inverse width
    counts: np.ndarray  # (axes,) intervals that there are
    member: np.ndarray  # (axes, M) interval of each box
    theta: np.ndarray  # (groups, M, GROUP) parameters, with zeros in the places that are left
    per_span: np.ndarray  # (S,) inverse span of each signal's normalisation


def prepare(net: FlatNetwork) -> Prepared:
    """Work out what does not change."""
    axes = list(zip(net.centres.T, net.widths.T, strict=True))
    found = [np.unique(np.column_stack(pair), axis=0, return_inverse=True) for pair in axes]
    count = np.array([len(intervals) for intervals, _ in found], dtype=np.int64)
    centre, per_width = np.zeros((2, len(found), count.max()))
    for axis, (intervals, _) in enumerate(found):
        centre[axis, : count[axis]] = intervals[:, 0]
        per_width[axis, : count[axis]] = 1.0 / intervals[:, 1]
    member = np.array([np.ravel(inverse) for _, inverse in found], dtype=np.int64)
    n_models, n_params = net.theta.shape
    theta = np.zeros((n_models, -(-n_params // GROUP) * GROUP))
    theta[:, :n_params] = net.theta
    groups = np.ascontiguousarray(theta.reshape(n_models, -1, GROUP).transpose(1, 0, 2))
    return Prepared(centre, per_width, count, member, groups, 1.0 / net.span)


@njit(**COMPILED)
def blend(
    prepared: Prepared,
    axis_signal: np.ndarray,
    axis_lag: np.ndarray,
    form: np.ndarray,
    history: np.ndarray,
    scratch: np.ndarray,
    base: float,
) -> None:
    """Validity functions at this hypothesis' state of charge, blended parameters, and the derivatives of both by it."""
    phi, turned = scratch[VALIDITY_ROW], scratch[TILT_ROW]
    centre, per_width, count, member = prepared.centre, prepared.per_width, prepared.counts, prepared.member
    n_models = member.shape[1]
    for i in range(n_models):
        phi[i], turned[i] = 1.0, 0.0
    for j in range(count.shape[0]):
        s, kernel, slope = axis_signal[j], scratch[AXIS_ROWS + 2 * j], scratch[AXIS_ROWS + 2 * j + 1]
        z, per_soc = inside_trained(int(form[s]), float(history[0, axis_lag[j], s])), 0.0
        if form[s] == SOC:
            per_soc = prepared.per_span[s]
            z += base * per_soc
        nearest = np.inf
        for u in range(count[j]):
            scaled = (z - centre[j, u]) * per_width[j, u]
            slope[u] = -per_soc * scaled * per_width[j, u]
            kernel[u] = 0.5 * scaled * scaled
            nearest = min(nearest, kernel[u])
        for u in range(count[j]):
            below = kernel[u] - nearest
            kernel[u] = np.exp(-below) if below < _FAR else 0.0
        for i in range(n_models):
            phi[i] *= kernel[member[j, i]]
        if per_soc != 0.0:
            for i in range(n_models):
                turned[i] += slope[member[j, i]]
    largest = 0.0
    for i in range(n_models):
        largest = max(largest, phi[i])
    if largest < _VANISHED:
        largest = _far_outside(prepared, axis_signal, axis_lag, form, history, phi, base)
    total, mean_tilt = 0.0, 0.0
    for i in range(n_models):
        if phi[i] < _NEGLIGIBLE * largest:
            phi[i] = 0.0
        total += phi[i]
        mean_tilt += phi[i] * turned[i]
    share = 1.0 / total
    mean_tilt *= share
    for i in range(n_models):
        phi[i] *= share
        turned[i] = phi[i] * (turned[i] - mean_tilt)
    _parameters(prepared.theta, phi, turned, scratch[BLENDED_ROW], scratch[TILTED_ROW])


@njit(**COMPILED)
def blend_hats(net: FlatNetwork, per_span: np.ndarray, history: np.ndarray, scratch: np.ndarray, base: float) -> int:
    """Do the same for hats, whose derivative by the state of charge is the slope between the two next knots.

    At and beyond the outermost knots the slope goes on for the derivative alone: where the estimate has run out of the
    curve, the voltage must still lead it back.

    Returns
    -------
    The lower of the two local models; validity functions of all others are not written.
    """
    phi, turned, blended, tilted = scratch[VALIDITY_ROW], scratch[TILT_ROW], scratch[BLENDED_ROW], scratch[TILTED_ROW]
    knots, theta, s = net.centres, net.theta, net.axis_signal[0]
    below, share = hat_interval(knots, history[0, net.axis_lag[0], s] + base * per_span[s])
    slope = per_span[s] / (knots[below + 1, 0] - knots[below, 0])
    phi[below], phi[below + 1] = 1.0 - share, share
    turned[below], turned[below + 1] = -slope, slope
    for p in range(theta.shape[1]):
        step = theta[below + 1, p] - theta[below, p]
        blended[p] = theta[below, p] + share * step
        tilted[p] = slope * step
    return below


@njit(**COMPILED)
def _parameters(
    theta: np.ndarray, phi: np.ndarray, turned: np.ndarray, blended: np.ndarray, tilted: np.ndarray
) -> None:
    """Parameters blended by the validity functions and by their derivatives."""
    for group in range(theta.shape[0]):
        # A sum for each place of the group, written out: the compiler holds them in one register.
        a0 = a1 = a2 = a3 = b0 = b1 = b2 = b3 = 0.0
        of_group = theta[group]
        for i in range(of_group.shape[0]):
            f, g = phi[i], turned[i]
            t0, t1, t2, t3 = of_group[i, 0], of_group[i, 1], of_group[i, 2], of_group[i, 3]
            a0 += f * t0
            a1 += f * t1
            a2 += f * t2
            a3 += f * t3
            b0 += g * t0
            b1 += g * t1
            b2 += g * t2
            b3 += g * t3
        p = GROUP * group
        blended[p], blended[p + 1], blended[p + 2], blended[p + 3] = a0, a1, a2, a3
        tilted[p], tilted[p + 1], tilted[p + 2], tilted[p + 3] = b0, b1, b2, b3


@njit(**COMPILED)
def _far_outside(
    prepared: Prepared,
    axis_signal: np.ndarray,
    axis_lag: np.ndarray,
    form: np.ndarray,
    history: np.ndarray,
    phi: np.ndarray,
    base: float,
) -> float:
    """Products of kernels relative to the largest, which is returned: none of them can be held by a double."""
    n_models = phi.shape[0]
    for i in range(n_models):
        phi[i] = 0.0
    for j in range(prepared.counts.shape[0]):
        s = axis_signal[j]
        z = inside_trained(int(form[s]), float(history[0, axis_lag[j], s]))
        z += base * prepared.per_span[s] if form[s] == SOC else 0.0
        for i in range(n_models):
            u = prepared.member[j, i]
            scaled = (z - prepared.centre[j, u]) * prepared.per_width[j, u]
            phi[i] -= 0.5 * scaled * scaled
    nearest = -np.inf
    for i in range(n_models):
        nearest = max(nearest, phi[i])
    for i in range(n_models):
        phi[i] = np.exp(phi[i] - nearest)
    return 1.0
