"""Whether the blended filter's error dies out, whatever the blend: a common quadratic Lyapunov function.

State matrix and gain are blended one by one, so the error goes through sums of G_ij = (I - K_j C) A_i with weights
phi_i phi_j. G_ij and G_ji always have the same weight, so that their mean H_ij stands for both; the error dies out for
every blend where one P > 0 has P - H_ij' P H_ij >= 0 for all pairs that overlap (Tanaka, Ikeda and Wang, IEEE Trans.
Fuzzy Systems 6, 1998). P comes from linear matrix inequalities where a solver for them is installed, else from a
series; either is verified. Of hats the state matrix holds the slope between two knots, which is no blend of theirs:
each interval has pairs of its own. This holds for the steady-state gains; the gain from the covariance
of the moment is that of a Kalman filter of the same matrices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.observer.certificate.lyapunov_lmi import lyapunov_by_lmi
from models.observer.filter.gains import (
    hat_slopes,
    knot_slopes,
    observer_matrices,
    output_rows,
)
from models.observer.filter.settings import ObserverSettings, default_settings, error_levels
from models.observer.filter.steady import designed_gains

# Two local models overlap where both weigh at least this much.
_OVERLAP = 0.02
_ROUNDS = 300
_LEAST_EIGENVALUE = 1e-12
_GRID = 400


@dataclass(frozen=True)
class Stability:
    """What can be said of the error's decay.

    Attributes
    ----------
    certified : a common Lyapunov function was found, and verified for every pair
    pairs : how many pairs of local models overlap, each with itself too
    margin : smallest eigenvalue of P - H' P H over all pairs, P of norm 1; not negative where certified
    contraction : largest growth of the error per sample in the norm of P over all pairs; below 1 it shrinks always
    spectral_radius : largest of a single pair; below 1 each pair by itself is stable
    p : (s, s) the Lyapunov function's matrix, in the scaled state
    """

    certified: bool
    pairs: int
    margin: float
    contraction: float
    spectral_radius: float
    p: FloatArray


def stability(network: LocalModelNetwork, settings: ObserverSettings | None = None) -> Stability:
    """Look for a common Lyapunov function of the observer with steady-state gains.

    Parameters
    ----------
    network : the model
    settings : noise; by default the model's own
    """
    assumed = settings or default_settings(network)
    matrices, _ = observer_matrices(network, assumed)
    rows = output_rows(network, assumed, error_levels(network))
    gains = designed_gains(network, assumed)[:, :-1]
    left = np.eye(matrices.shape[1]) - gains[:, :, None] * rows[:, None, :]
    if network.structure.kernel == "hat":
        return common_lyapunov(_maps_between_knots(network, left, matrices))
    pairs = overlapping_pairs(network)
    return common_lyapunov(np.array([0.5 * (left[j] @ matrices[i] + left[i] @ matrices[j]) for i, j in pairs]))


def _maps_between_knots(network: LocalModelNetwork, left: FloatArray, matrices: FloatArray) -> FloatArray:
    """(3 (M - 1), s, s) error maps of the pairs in each interval between knots, with the slope that it has.

    Parameters
    ----------
    network : by hats
    left : (M, s, s) what the gain at each knot leaves of the error, I - K_j C_j
    matrices : (M, s, s) state matrices with the mean slopes at the knots
    """
    maps, mean, at_soc = [], knot_slopes(network), max(network.structure.output_order, 1)
    for below, slope in enumerate(hat_slopes(network)):
        both = slice(below, below + 2)
        own = matrices[both].copy()
        own[:, 0, at_soc] += slope - mean[both]
        a, b = left[both]
        maps += [a @ own[0], 0.5 * (a @ own[1] + b @ own[0]), b @ own[1]]
    return np.array(maps)


def common_lyapunov(maps: FloatArray) -> Stability:
    """Find P > 0 with P - H' P H >= 0 for all maps H, and verify it.

    Parameters
    ----------
    maps : (m, s, s)

    Returns
    -------
    Stability
        Where no P was found, the contraction bound of the best one: above 1, nothing is proven.
    """
    radius = max(float(np.abs(np.linalg.eigvals(g)).max()) for g in maps)
    # States of different size would hide one another: scaled to what the mean map's own Lyapunov function says.
    scale = _scale(maps)
    scaled = maps / scale[:, None] * scale[None, :]
    best_p = lyapunov_by_lmi(scaled)
    if best_p is None or not _proves(best_p, scaled):
        best_p = _by_series(scaled)
    best = float(_growths(best_p, scaled).max())
    p = best_p / np.linalg.norm(best_p)
    return Stability(_proves(p, scaled), len(maps), _margin(p, scaled), float(np.sqrt(best)), radius, p)


def _by_series(maps: FloatArray) -> FloatArray:
    """P for which the largest growth through any map is small, found by adding what the worst map needs."""
    p = np.eye(maps.shape[1])
    best_p, best = p, np.inf
    for _ in range(_ROUNDS):
        growth = _growths(p, maps)
        worst = int(np.argmax(growth))
        if growth[worst] < best:
            best_p, best = p, float(growth[worst])
        if best <= 1.0:
            break
        # What the worst map needs beside what the others do: its own series of G'^k P G^k, cut off.
        shrunk = maps[worst] * min(1.0, 0.999 / max(_radius(maps[worst]), 1e-12))
        p = p + solve_discrete_lyapunov(shrunk.T, p / np.linalg.norm(p))
        p = 0.5 * (p + p.T) / np.linalg.norm(p)
        if np.linalg.eigvalsh(p).min() < _LEAST_EIGENVALUE:
            break  # an eigenvalue of the map is so near the unit circle that its series is lost in rounding
    return best_p


def _margin(p: FloatArray, maps: FloatArray) -> float:
    return min(float(np.linalg.eigvalsh(p - g.T @ p @ g).min()) for g in maps)


def _proves(p: FloatArray, maps: FloatArray) -> bool:
    return bool(np.linalg.eigvalsh(p).min() > _LEAST_EIGENVALUE and _margin(p, maps) >= -1e-12)


def overlapping_pairs(network: LocalModelNetwork) -> list[tuple[int, int]]:
    """Pairs i <= j of local models, each with itself too, that weigh something at the same place."""
    partition = network.partition
    rng = np.random.default_rng(0)
    between = rng.uniform(0.0, 1.0, (_GRID, partition.centres.shape[1]))
    validity = partition.validity(np.vstack([partition.centres, between])) >= _OVERLAP
    together = validity.astype(float).T @ validity
    return [(i, j) for i in range(network.n_models) for j in range(i, network.n_models) if i == j or together[i, j] > 0]


def _growths(p: FloatArray, maps: FloatArray) -> FloatArray:
    """(m,) largest growth of x' P x through each map."""
    root = np.linalg.cholesky(p)
    inverse = np.linalg.inv(root)
    return np.array([np.linalg.norm(root.T @ g @ inverse.T, 2) ** 2 for g in maps])


def _scale(maps: FloatArray) -> FloatArray:
    mean = maps.mean(axis=0)
    shrunk = mean * min(1.0, 0.9999 / max(_radius(mean), 1e-12))
    size = np.sqrt(np.diag(solve_discrete_lyapunov(shrunk, np.eye(len(mean)))))
    return size / size.min()


def _radius(matrix: FloatArray) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max())
