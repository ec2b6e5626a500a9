"""Linear equations in coefficients of very different sizes, of which no sample speaks of some."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from models.data.timeseries import FloatArray

# Of the size of a coefficient's prior at its bound, where the information alone would call it exact.
_RIDGE = 1e-9
# Of the largest of a matrix, below which a number says nothing.
_NOTHING = 1e-15


def solve_scaled(information: FloatArray, right: FloatArray) -> FloatArray:
    """(P, k) solution of a (P, P) symmetric information for (P, k) right sides.

    Raises
    ------
    numpy.linalg.LinAlgError
        The information is not finite, or far from what squares add up to.
    """
    # What no sample says anything of has no scale of its own.
    diagonal = np.diag(information)
    scale = 1.0 / np.sqrt(np.maximum(diagonal, _NOTHING * diagonal.max()))
    scaled = information * np.outer(scale, scale) + _RIDGE * np.eye(len(information))
    return scale[:, None] * cho_solve(cho_factor(scaled), scale[:, None] * right)
