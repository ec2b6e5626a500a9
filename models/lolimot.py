"""Construction of the network: the worst local model is split where that helps most (LOLIMOT).

Nelles 2001; with prepartitioning and dimensions that may not be split, after Unger et al. 2014 (ch. 2.2.2, 2.2.3.3).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from models.errors import NotIdentifiableError
from models.local_model_network import one_step_regressors
from models.partition import Partition, initial_partition
from models.regression import Dataset
from models.structure import Structure
from models.timeseries import FloatArray

# Samples (weighted by validity) per parameter below which a local model may not be split further.
_MIN_SAMPLES_PER_PARAMETER = 8.0
# Ridge of the local estimates relative to the information in the data: a direction that a local model's data do
# not excite falls back to the model of all data instead of to noise.
_RIDGE = 1e-6


@dataclass(frozen=True)
class LocalFit:
    """One state of the construction.

    Attributes
    ----------
    partition : boxes
    theta : (M, p) weighted least-squares estimates
    loss : (M,) squared one-step error, weighted by validity
    samples : (M,) samples in each box, weighted by validity
    """

    partition: Partition
    theta: FloatArray
    loss: FloatArray
    samples: FloatArray


@dataclass(frozen=True)
class _Products:
    """Products of regressors and output, computed once; all local normal equations are one matrix product away."""

    phi: FloatArray
    y: FloatArray
    z: FloatArray
    packed: FloatArray
    upper: tuple[np.ndarray, np.ndarray]
    fallback: FloatArray


def construct(
    structure: Structure,
    data: Dataset,
    max_models: int,
    use: np.ndarray | None = None,
) -> Iterator[LocalFit]:
    """Grow a network from its prepartition, one local model at a time.

    Parameters
    ----------
    structure : which axes may be split, and the prepartition
    data : training samples
    max_models : largest number of local models
    use : (N,) True where a sample takes part; held-out samples do not

    Yields
    ------
    LocalFit
        First the prepartition, then each larger network; ends early where no box has enough data to be split.
    """
    products = _prepare(structure, data, use)
    current = _fit(initial_partition(structure.axes, structure.kernel), products)
    while True:
        yield current
        if current.partition.n_models >= max_models:
            return
        grown = _grow(structure, current, products)
        if grown is None:
            return
        current = grown


def _prepare(structure: Structure, data: Dataset, use: np.ndarray | None) -> _Products:
    phi = one_step_regressors(data, structure.output_order)
    known = ~(np.isnan(data.y) | np.isnan(phi).any(axis=1))
    if use is not None:
        known &= use
    if known.sum() < 2 * phi.shape[1]:
        raise NotIdentifiableError(
            f"{int(known.sum())} usable samples for {phi.shape[1]} parameters of one local model; "
            "record a longer run or use the minimal structure"
        )
    phi, y, z = phi[known], data.y[known], data.z[known]
    extended = np.column_stack([phi, y])
    upper = np.triu_indices(extended.shape[1])
    packed = extended[:, upper[0]] * extended[:, upper[1]]
    total = _unpack(packed.sum(axis=0), upper, extended.shape[1])
    p = phi.shape[1]
    ridge = _RIDGE * np.trace(total[:p, :p]) / p * np.eye(p)
    fallback = np.linalg.solve(total[:p, :p] + ridge, total[:p, p])
    return _Products(phi, y, z, packed, upper, fallback)


def _unpack(packed: FloatArray, upper: tuple[np.ndarray, np.ndarray], size: int) -> FloatArray:
    matrix = np.zeros((*packed.shape[:-1], size, size))
    matrix[..., upper[0], upper[1]] = packed
    matrix[..., upper[1], upper[0]] = packed
    return matrix


def _fit(partition: Partition, products: _Products) -> LocalFit:
    """Weighted least squares of all local models at once."""
    validity = partition.validity(products.z)
    p = products.phi.shape[1]
    moments = _unpack(validity.T @ products.packed, products.upper, p + 1)
    information, right = moments[:, :p, :p], moments[:, :p, p]
    scale = np.sqrt(np.einsum("ipp->ip", information) / np.maximum(validity.sum(axis=0), 1e-12)[:, None]) + 1e-12
    ridge = _RIDGE * validity.sum(axis=0)[:, None] * scale**2 + 1e-12
    regular = information + np.einsum("ip,pq->ipq", ridge, np.eye(p))
    theta = np.linalg.solve(regular, (right + ridge * products.fallback)[..., None])[..., 0]
    error = products.y - np.einsum("kp,kp->k", products.phi, validity @ theta)
    return LocalFit(partition, theta, validity.T @ error**2, validity.sum(axis=0))


def _grow(structure: Structure, current: LocalFit, products: _Products) -> LocalFit | None:
    """Split the worst box that has enough data, along the axis that lowers the total loss most."""
    enough = 2.0 * _MIN_SAMPLES_PER_PARAMETER * products.phi.shape[1]
    for worst in np.argsort(current.loss)[::-1]:
        if current.samples[worst] < enough:
            continue
        candidates = [
            _fit(current.partition.split(int(worst), axis), products)
            for axis, description in enumerate(structure.axes)
            if description.splittable
        ]
        candidates = [c for c in candidates if min(c.samples[worst], c.samples[-1]) >= enough / 2.0]
        if candidates:
            return min(candidates, key=lambda fit: float(fit.loss.sum()))
    return None
