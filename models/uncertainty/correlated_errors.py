"""Covariance of least-squares estimates whose residuals hang together in time."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray

# Residuals that hardly change from sample to sample would ask for a window as long as the record.
_LONGEST_SHARE = 0.1


def least_squares_covariance(jacobian: FloatArray, residual: FloatArray, starts: tuple[int, ...] = (0,)) -> FloatArray:
    """(p, p) covariance of parameters fitted by least squares, honest where neighbouring residuals are alike.

    Parameters
    ----------
    jacobian : (n, p) derivatives of the simulated values to the parameters, full column rank
    residual : (n,) measured minus simulated
    starts : first sample of each run; residuals of different runs are independent

    Returns
    -------
    (p, p); of the two estimates with and without correlation the one with the larger variances.

    Notes
    -----
    Newey and West, Econometrica 55, 1987 (Bartlett window); its length after Andrews, Econometrica 59, 1991, eq. 6.2
    and 6.4 with a first-order autoregression.
    """
    from scipy.signal import oaconvolve  # Lazy: 0.4 s of processor time.

    n, p = jacobian.shape
    bread = np.linalg.inv(jacobian.T @ jacobian)
    white = bread * float(residual @ residual) / max(n - p, 1)
    scores = jacobian * residual[:, None]
    bounds = [*starts, n]
    parts = [slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
    window = _window([residual[part] for part in parts])
    meat = np.zeros((p, p))
    for part in parts:
        rows = scores[part]
        lags = min(window, len(rows) - 1)
        weight = 1.0 - np.abs(np.arange(-lags, lags + 1)) / (window + 1.0)
        # All lags at once: as many as the records of slow sensors ask for would cost their number of products.
        product = rows.T @ oaconvolve(rows, weight[:, None], mode="full", axes=0)[lags : lags + len(rows)]
        meat += 0.5 * (product + product.T)
    correlated = bread @ meat @ bread * n / max(n - p, 1)
    scale = np.sqrt(np.maximum(np.diag(white) / np.maximum(np.diag(correlated), 1e-300), 1.0))
    return correlated * np.outer(scale, scale)


def _window(parts: list[FloatArray]) -> int:
    """Number of lags that count."""
    products = sum(float(part[1:] @ part[:-1]) for part in parts)
    squares = sum(float(part @ part) for part in parts)
    n = sum(len(part) for part in parts)
    rho = float(np.clip(products / max(squares, 1e-300), -0.999, 0.999))
    alpha = 4.0 * rho**2 / ((1.0 - rho) ** 2 * (1.0 + rho) ** 2)
    return int(min(1.1447 * (alpha * n) ** (1.0 / 3.0), _LONGEST_SHARE * n))
