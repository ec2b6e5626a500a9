"""Scalar measures of an information matrix: A, D and E optimality (eq. 2.13 to 2.15 of the method).

All three are written so that more is better and that a factor on the information adds a constant: -log trace(inverse),
log det and log of the smallest eigenvalue. The logarithm changes no optimum; det itself would overflow.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import cho_factor, cho_solve, get_lapack_funcs

from models.data.errors import NotIdentifiableError
from models.data.timeseries import FloatArray

# Value and derivative to the information matrix, which is symmetric.
Criterion = Callable[[FloatArray], tuple[float, FloatArray]]


def d_optimality(information: FloatArray) -> tuple[float, FloatArray]:
    """Log det, and its derivative: the inverse."""
    value, factor = log_det(information)
    return value, inverse_of(factor)


def log_det(information: FloatArray) -> tuple[float, FloatArray]:
    """Log det, and the lower Cholesky factor that it comes from; what stands above its diagonal is to be ignored."""
    factor, _ = _cholesky(information)
    return 2.0 * float(np.log(np.diag(factor)).sum()), factor


def inverse_of(factor: FloatArray) -> FloatArray:
    """Inverse of a matrix from its lower Cholesky factor: a third of the work of solving for the unit matrix."""
    (potri,) = get_lapack_funcs(("potri",), (factor,))
    lower = np.tril(potri(factor, lower=1)[0])
    return lower + np.tril(lower, -1).T


def root_of_inverse(factor: FloatArray) -> FloatArray:
    """Lower triangular W with W' W the inverse of a matrix, from its lower Cholesky factor."""
    (trtri,) = get_lapack_funcs(("trtri",), (factor,))
    return np.tril(trtri(factor, lower=1)[0])


def a_optimality(information: FloatArray) -> tuple[float, FloatArray]:
    """-log of the sum of the variances, and its derivative."""
    inverse = cho_solve(_cholesky(information), np.eye(len(information)), check_finite=False)
    trace = float(np.trace(inverse))
    return -float(np.log(trace)), inverse @ inverse / trace


def e_optimality(information: FloatArray) -> tuple[float, FloatArray]:
    """Log of the smallest eigenvalue, and its derivative where that eigenvalue is simple."""
    values, vectors = np.linalg.eigh(information)
    if not values[0] > 0.0:
        raise _singular()
    return float(np.log(values[0])), np.outer(vectors[:, 0], vectors[:, 0]) / values[0]


CRITERIA: dict[str, Criterion] = {"A": a_optimality, "D": d_optimality, "E": e_optimality}


def efficiency(log_det: float, reference_log_det: float, n_parameters: int) -> float:
    """D-efficiency per parameter: (det ratio)^(1 / parameters).

    The same share by which, at equal efficiency, the test could be shorter.
    """
    return float(np.exp((log_det - reference_log_det) / n_parameters))


def _cholesky(information: FloatArray) -> tuple[FloatArray, bool]:
    try:
        return cho_factor(information, lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        raise _singular() from None


def _singular() -> NotIdentifiableError:
    return NotIdentifiableError(
        "the information matrix is singular: the experiment leaves a combination of parameters undetermined and no "
        "prior information covers it. Give a prior, excite more, or use fewer local models"
    )
