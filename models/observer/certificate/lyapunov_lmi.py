"""A common Lyapunov function by linear matrix inequalities, where the solver Clarabel is installed (extra `lmi`)."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from scipy import sparse

from models.data.timeseries import FloatArray


def lyapunov_by_lmi(maps: FloatArray) -> FloatArray | None:
    """P with P - G' P G >= t I for all maps G and 0 <= P <= I, t as large as possible.

    What a solver returns holds to its tolerance only: the inequalities are to be verified.

    Parameters
    ----------
    maps : (m, s, s)

    Returns
    -------
    (s, s), or None where Clarabel is not installed or finds no such P
    """
    try:
        clarabel: Any = import_module("clarabel")
    except ImportError:
        return None
    size = maps.shape[1]
    basis = _basis(size)
    falls = basis[None] - np.einsum("mba,kbc,mcd->mkad", maps, basis, maps)
    n, identity = len(basis), _packed(np.eye(size))
    # Unknowns: P's packed entries and t. Clarabel wants b - A x in the cone.
    decay = [np.column_stack([-_packed(fall).T, identity]) for fall in falls]
    below_one = np.column_stack([np.eye(n), np.zeros(n)])
    rows = sparse.csc_matrix(np.vstack([*decay, below_one]))
    right = np.concatenate([np.zeros(n * len(maps)), identity])
    cones = [clarabel.PSDTriangleConeT(size)] * (len(maps) + 1)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    nothing = sparse.csc_matrix((n + 1, n + 1))
    solver = clarabel.DefaultSolver(nothing, np.append(np.zeros(n), -1.0), rows, right, cones, settings)
    solution = np.array(solver.solve().x)
    if not np.isfinite(solution).all() or solution[-1] <= 0.0:
        return None
    return np.tensordot(solution[:-1], basis, axes=1)


def _basis(size: int) -> FloatArray:
    """(n, s, s) symmetric matrices of unit norm, upper triangle column by column."""
    pairs = [(i, j) for j in range(size) for i in range(j + 1)]
    out = np.zeros((len(pairs), size, size))
    for k, (i, j) in enumerate(pairs):
        out[k, i, j] = out[k, j, i] = 1.0 if i == j else np.sqrt(0.5)
    return out


def _packed(matrices: FloatArray) -> FloatArray:
    """(..., n) coordinates of symmetric matrices in that basis."""
    size = matrices.shape[-1]
    j, i = np.tril_indices(size)
    return matrices[..., i, j] * np.where(i == j, 1.0, np.sqrt(2.0))
