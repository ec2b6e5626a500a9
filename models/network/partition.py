"""The partition space: axis-parallel boxes and the validity functions that blend their local models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from models.data.errors import StructureError
from models.data.timeseries import FloatArray
from models.network.hats import boxes_around, hat_validity, knots_of
from models.network.structure import PartitionAxis


@dataclass(frozen=True)
class Partition:
    """Boxes that tile the normalised partition space, or lie about the knots of hats.

    Attributes
    ----------
    lower, upper : (M, n_axes) box edges; every partition variable is normalised to 0..1 over the trained range
    k_sigma : (n_axes,) kernel width over box width
    kernel : "gaussian", "uniform", "triangular" or "hat"
    held : (n_axes,) which variables are held at the edges of the trained range; by default none
    """

    lower: FloatArray
    upper: FloatArray
    k_sigma: FloatArray
    kernel: str = "gaussian"
    held: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        """Check the knots of hats."""
        if self.kernel == "hat":
            knots_of(self.lower, self.upper)

    @property
    def n_models(self) -> int:
        """Number of local models."""
        return len(self.lower)

    @property
    def centres(self) -> FloatArray:
        """(M, n_axes) box centres c_ij of eq. 2.5; of hats the knots."""
        return 0.5 * (self.lower + self.upper)

    @property
    def widths(self) -> FloatArray:
        """(M, n_axes) kernel widths sigma_ij of eq. 2.6."""
        return np.asarray((self.upper - self.lower) * self.k_sigma)

    def validity(self, z: FloatArray) -> FloatArray:
        """Validity functions of every local model (eq. 2.4 and 2.5).

        Parameters
        ----------
        z : (N, n_axes) normalised partition variables

        Returns
        -------
        (N, M), each row sums to 1. Far outside the boxes the nearest one takes all, along axes that are not held.
        """
        z = np.ascontiguousarray(z)
        if self.kernel == "hat":
            return np.asarray(hat_validity(self.centres, z[:, 0]))
        if any(self.held):
            z = np.where(self.held, np.clip(z, 0.0, 1.0), z)
        if self.kernel == "gaussian":
            out = np.asarray(_relative_exponents(z, self.centres, 1.0 / self.widths))
            np.exp(out, out=out)
            out /= out.sum(axis=1, keepdims=True)
            return out
        return _normalised(self._bounded_kernel(z), z, self.centres, self.widths)

    def split(self, model: int, axis: int) -> Partition:
        """Cut one box in two halves along `axis`; the upper half becomes the last model.

        Raises
        ------
        StructureError
            The partition is one by hats, which needs its knots in order.
        """
        if self.kernel == "hat":
            raise StructureError("a partition by hats is not split; give `hat_partition` more knots")
        middle = 0.5 * (self.lower[model, axis] + self.upper[model, axis])
        lower = np.vstack([self.lower, self.lower[model]])
        upper = np.vstack([self.upper, self.upper[model]])
        upper[model, axis] = middle
        lower[-1, axis] = middle
        return Partition(lower, upper, self.k_sigma, self.kernel, self.held)

    def neighbours(self) -> list[tuple[int, int]]:
        """Pairs of boxes that share a face; of hats, of knots that follow each other."""
        if self.kernel == "hat":
            return [(i, i + 1) for i in range(self.n_models - 1)]
        low, high = self.lower, self.upper
        overlap = np.minimum(high[:, None], high[None]) - np.maximum(low[:, None], low[None])
        touching = np.abs(overlap) < 1e-12
        face = (touching.sum(axis=2) == 1) & (touching | (overlap > 1e-12)).all(axis=2)
        return [(int(i), int(j)) for i, j in zip(*np.nonzero(np.triu(face, 1)), strict=True)]

    def _bounded_kernel(self, z: FloatArray) -> FloatArray:
        distance = np.abs(z[:, None, :] - self.centres[None]) / (self.widths[None])
        if self.kernel == "uniform":
            return np.asarray(np.all(distance <= 1.0, axis=2), dtype=np.float64)
        return np.multiply.reduce(np.maximum(1.0 - 0.5 * distance, 0.0), axis=2)


def initial_partition(axes: tuple[PartitionAxis, ...], kernel: str = "gaussian") -> Partition:
    """Prepartition: each axis in its `initial` equal parts."""
    edges = [np.linspace(0.0, 1.0, axis.initial + 1) for axis in axes]
    cells = np.indices([axis.initial for axis in axes]).reshape(len(axes), -1).T
    lower = np.array([[edges[a][c] for a, c in enumerate(cell)] for cell in cells])
    upper = np.array([[edges[a][c + 1] for a, c in enumerate(cell)] for cell in cells])
    return Partition(lower, upper, np.array([axis.k_sigma for axis in axes]), kernel, tuple(axis.held for axis in axes))


def hat_partition(knots: FloatArray) -> Partition:
    """Partition by hats: local models at knots, blended in straight lines.

    Parameters
    ----------
    knots : (M,) normalised states of charge, strictly rising; they need not be even

    Raises
    ------
    StructureError
        There are fewer than two knots, or they do not rise.
    """
    given = np.asarray(knots, dtype=np.float64)
    knots_of(given[:, None], given[:, None])
    return Partition(*boxes_around(given), np.ones(1), "hat")


@njit(cache=True, fastmath=False)
def _relative_exponents(z: np.ndarray, centres: np.ndarray, inverse_widths: np.ndarray) -> np.ndarray:
    """(N, M) exponents less the largest of each row, so that far outside all boxes the sum does not underflow to 0."""
    n, n_axes = z.shape
    n_models = centres.shape[0]
    out = np.empty((n, n_models))
    for k in range(n):
        largest = -np.inf
        for i in range(n_models):
            exponent = 0.0
            for j in range(n_axes):
                scaled = (z[k, j] - centres[i, j]) * inverse_widths[i, j]
                exponent -= 0.5 * scaled * scaled
            out[k, i] = exponent
            largest = max(largest, exponent)
        for i in range(n_models):
            out[k, i] -= largest
    return out


def _normalised(mu: FloatArray, z: FloatArray, centres: FloatArray, widths: FloatArray) -> FloatArray:
    """Divide by the sum; where no kernel of bounded support reaches, the nearest box takes all."""
    total = mu.sum(axis=1)
    lost = total <= 0.0
    if lost.any():
        distance = (((z[lost, None, :] - centres[None]) / widths[None]) ** 2).sum(axis=2)
        mu[lost] = 0.0
        mu[np.flatnonzero(lost), distance.argmin(axis=1)] = 1.0
        total = mu.sum(axis=1)
    return mu / total[:, None]
