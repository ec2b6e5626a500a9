"""Construction of the network: the worst local model is split where that helps most (LOLIMOT).

Nelles 2001; with prepartitioning and dimensions that may not be split, after Unger et al. 2014 (ch. 2.2.2, 2.2.3.3).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from models.data.errors import NotIdentifiableError, StructureError
from models.data.timeseries import FloatArray
from models.network.partition import Partition, initial_partition
from models.network.recursion import one_step_regressors
from models.network.regression import Dataset
from models.network.structure import Structure

# Samples (weighted by validity) per parameter below which a local model may not be split further.
_MIN_SAMPLES_PER_PARAMETER = 8.0
# Samples that decide on splits; a record of twice as many or more is thinned to no fewer.
_DECIDING = 12_000
# Samples that are worked on at once, so that their validity functions stay in the cache.
_BLOCK = 2048
# Sums of kernels below this have lost digits.
_SMALLEST_SUM = 1e-200
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
    """Products of regressors and output, computed once; all local normal equations are one matrix product away.

    `weight` is how many samples each one stands for.
    """

    phi: FloatArray
    y: FloatArray
    z: FloatArray
    upper: tuple[np.ndarray, np.ndarray]
    fallback: FloatArray
    weight: int = 1

    @cached_property
    def packed(self) -> FloatArray:
        """(N, (p + 1) (p + 2) / 2) products of regressors and output."""
        extended = np.column_stack([self.phi, self.y])
        return extended[:, self.upper[0]] * extended[:, self.upper[1]]

    def thinned(self) -> _Products:
        """Every n-th sample, where there are more than decide on a split; neighbours tell the same."""
        step = len(self.y) // _DECIDING
        if step < 2:
            return self
        return replace(
            self,
            phi=self.phi[::step].copy(),
            y=self.y[::step].copy(),
            z=self.z[::step].copy(),
            weight=step * self.weight,
        )


@dataclass(frozen=True)
class _Kernels:
    """Kernels of all local models before they are normalised: a split changes two rows of them.

    Attributes
    ----------
    values : (M, N)
    total : (N,) their sum
    """

    values: FloatArray
    total: FloatArray

    @classmethod
    def of(cls, partition: Partition, z: FloatArray) -> _Kernels:
        """All kernels of a partition."""
        if partition.kernel == "gaussian":
            values = np.array([_gaussian(partition, i, z) for i in range(partition.n_models)])
            total = values.sum(axis=0)
            if total.min() > _SMALLEST_SUM:
                return cls(values, total)
        return cls(np.ascontiguousarray(partition.validity(z).T), np.ones(len(z)))

    def split(self, partition: Partition, model: int, z: FloatArray) -> _Kernels:
        """Kernels after `model` was cut in two halves, the upper of which is the last one of `partition`."""
        if partition.kernel != "gaussian":
            return _Kernels.of(partition, z)
        values = np.vstack([self.values, _gaussian(partition, partition.n_models - 1, z)])
        values[model] = _gaussian(partition, model, z)
        total = values.sum(axis=0)
        return _Kernels(values, total) if total.min() > _SMALLEST_SUM else _Kernels.of(partition, z)


def _gaussian(partition: Partition, model: int, z: FloatArray) -> FloatArray:
    """(N,) kernel of one local model (eq. 2.5)."""
    exponent = np.zeros(len(z))
    for axis, (centre, width) in enumerate(zip(partition.centres[model], partition.widths[model], strict=True)):
        scaled = (z[:, axis] - centre) / width
        exponent -= 0.5 * scaled * scaled
    return np.exp(exponent)


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
        First the prepartition, then each larger network; ends early where no box has enough data to be split. Of long
        records every n-th sample decides on the splits; the last network is fitted to all of them.
    """
    every = _prepare(one_step_regressors(data, structure.output_order), data.y, data.z, use)
    thinned = every.thinned()
    if thinned is every:
        yield from _grown(structure, every, max_models)
        return
    *earlier, last = _grown(structure, thinned, max_models)
    yield from earlier
    yield _fit(last.partition, _Kernels.of(last.partition, every.z), every)


def grow_partitions(
    structure: Structure, inputs: FloatArray, target: FloatArray, z: FloatArray, max_models: int, weight: int = 1
) -> Iterator[Partition]:
    """Boxes of networks whose local models have regressors of their own making, from the prepartition on.

    Parameters
    ----------
    structure : which axes may be split, and the prepartition
    inputs : (N, q) regressors; passed through a common filter for boxes that suit the free run
    target : (N,) what they are to explain
    z : (N, n_axes) partition variables
    max_models : largest number of local models
    weight : how many samples of the record each one stands for: a thinned record allows as many boxes
    """
    products = replace(_prepare(inputs, target, z, None), weight=weight)
    for fit in _grown(structure, products.thinned(), max_models):
        yield fit.partition


def _grown(structure: Structure, products: _Products, max_models: int) -> Iterator[LocalFit]:
    """The prepartition, then each larger network."""
    if structure.kernel == "hat":
        raise StructureError(
            f"structure {structure.name!r} has hats, whose knots are given: it is fitted with bounds, not grown by "
            "splitting. Use the structure 'bounded', or another kernel"
        )
    partition = initial_partition(structure.axes, structure.kernel)
    kernels = _Kernels.of(partition, products.z)
    current = _fit(partition, kernels, products)
    yield current
    while current.partition.n_models < max_models:
        grown = _grow(structure, current, kernels, products)
        if grown is None:
            return
        current, kernels = grown
        yield current


def _prepare(phi: FloatArray, y: FloatArray, z: FloatArray, use: np.ndarray | None) -> _Products:
    known = ~(np.isnan(y) | np.isnan(phi).any(axis=1))
    if use is not None:
        known &= use
    if known.sum() < 2 * phi.shape[1]:
        raise NotIdentifiableError(
            f"{int(known.sum())} usable samples for {phi.shape[1]} parameters of one local model; "
            "record a longer run or use the minimal structure"
        )
    phi, y, z = phi[known], y[known], z[known]
    p = phi.shape[1]
    total = phi.T @ phi
    ridge = _RIDGE * np.trace(total) / p * np.eye(p)
    fallback = np.linalg.solve(total + ridge, phi.T @ y)
    return _Products(phi, y, z, np.triu_indices(p + 1), fallback)


def _unpack(packed: FloatArray, upper: tuple[np.ndarray, np.ndarray], size: int) -> FloatArray:
    matrix = np.zeros((*packed.shape[:-1], size, size))
    matrix[..., upper[0], upper[1]] = packed
    matrix[..., upper[1], upper[0]] = packed
    return matrix


def _fit(partition: Partition, kernels: _Kernels, products: _Products) -> LocalFit:
    """Weighted least squares of all local models at once."""
    p = products.phi.shape[1]
    inverse = 1.0 / kernels.total
    sums, samples = np.zeros((partition.n_models, products.packed.shape[1])), np.zeros(partition.n_models)
    for part in _blocks(len(inverse)):
        validity = kernels.values[:, part] * inverse[part]
        sums += validity @ products.packed[part]
        samples += validity.sum(axis=1)
    moments = _unpack(sums, products.upper, p + 1)
    information, right = moments[:, :p, :p], moments[:, :p, p]
    scale = np.sqrt(np.einsum("ipp->ip", information) / np.maximum(samples, 1e-12)[:, None]) + 1e-12
    ridge = _RIDGE * samples[:, None] * scale**2 + 1e-12
    regular = information + np.einsum("ip,pq->ipq", ridge, np.eye(p))
    theta = np.linalg.solve(regular, (right + ridge * products.fallback)[..., None])[..., 0]
    loss = np.zeros(partition.n_models)
    for part in _blocks(len(inverse)):
        validity = kernels.values[:, part] * inverse[part]
        error = products.y[part] - np.einsum("kp,kp->k", products.phi[part], validity.T @ theta)
        loss += validity @ error**2
    return LocalFit(partition, theta, products.weight * loss, products.weight * samples)


def _blocks(n: int) -> Iterator[slice]:
    return (slice(first, first + _BLOCK) for first in range(0, n, _BLOCK))


def _grow(
    structure: Structure, current: LocalFit, kernels: _Kernels, products: _Products
) -> tuple[LocalFit, _Kernels] | None:
    """Split the worst box that has enough data, along the axis that lowers the total loss most."""
    enough = 2.0 * _MIN_SAMPLES_PER_PARAMETER * products.phi.shape[1]
    for worst in np.argsort(current.loss)[::-1]:
        if current.samples[worst] < enough:
            continue
        candidates = []
        for axis in (axis for axis, description in enumerate(structure.axes) if description.splittable):
            partition = current.partition.split(int(worst), axis)
            split = kernels.split(partition, int(worst), products.z)
            candidates.append((_fit(partition, split, products), split))
        candidates = [(c, k) for c, k in candidates if min(c.samples[worst], c.samples[-1]) >= enough / 2.0]
        if candidates:
            return min(candidates, key=lambda grown: float(grown[0].loss.sum()))
    return None
