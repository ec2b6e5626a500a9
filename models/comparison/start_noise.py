"""What a model's error is expected to be where the start is right: what the estimate of a start is weighed against.

A model's errors hang together over minutes and hours. Taken for independent, a few mV of them would place any start. So
errors are averaged over spans that grow from the start on, and the means are made white with their covariance, which
has a closed form for exponentially fading correlations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.module.network import ModuleNetwork
from models.network.cell_model import CellModel
from models.network.local_model_network import LocalModelNetwork
from models.uncertainty.bands import prediction_band
from models.uncertainty.correlation import ResidualCorrelation, fit_correlation
from models.uncertainty.model_uncertainty import uncertainty_of

# Spans: as short as a sample at first, then this share of the time that has passed, at most this share of the run.
_GROWTH = 0.1
_SPANS = 200
# A model that says nothing of its error is taken to be off by this much, most of it slowly.
_UNKNOWN_V = 5e-3
_UNKNOWN = (0.1, np.array([0.3, 0.6]), (60.0, 3600.0))
# Of the part of an error's variance that hangs together, as much does so over a whole run: a model that is off by its
# structure is off alike whenever the cell comes by, and that must not pass for a state of charge.
_ALL_ALONG = 0.5
# Nothing is known better than this: resolution and noise of a converter.
_LEAST_V = 2e-4


@dataclass(frozen=True)
class ErrorModel:
    """Expected error of a free run from the right start.

    Attributes
    ----------
    level_V : standard deviation
    correlation : from one sample of the model's grid to the next
    """

    level_V: float
    correlation: ResidualCorrelation


@dataclass(frozen=True)
class Whitener:
    """Turns a run's error into as many independent numbers as it is worth, each of variance 1.

    Attributes
    ----------
    first, end : (m,) samples of each span
    known : (n,) where a voltage was measured
    inverse : (m, m) lower triangle
    """

    first: np.ndarray
    end: np.ndarray
    known: np.ndarray
    inverse: FloatArray

    def white(self, error_V: FloatArray) -> FloatArray:
        """(m,) of an error (n,) in V; what is not known does not count."""
        total = np.concatenate([[0.0], np.cumsum(np.where(self.known, error_V, 0.0))])
        count = np.concatenate([[0], np.cumsum(self.known)])
        mean = (total[self.end] - total[self.first]) / (count[self.end] - count[self.first])
        return self.inverse @ mean


def error_model(model: CellModel, run: GridRun, initial_soc: float) -> ErrorModel:
    """Expected error of a model on a run, by what its record says.

    Parameters
    ----------
    model : its record may hold the held-out error and its correlation
    run : the part of the run that is to be judged; far from the training data more error is expected
    initial_soc : at its start
    """
    if isinstance(model, ModuleNetwork):
        mean = error_model(model.network, model.mean_cell_run(run), initial_soc)
        return ErrorModel(model.module.cells_in_series * mean.level_V, mean.correlation)
    uncertainty = uncertainty_of(model) if isinstance(model, LocalModelNetwork) else None
    if uncertainty is None or not isinstance(model, LocalModelNetwork):
        white, shares, fading_s = _UNKNOWN
        correlation = ResidualCorrelation(white, shares, np.exp(-run.dt_s / np.array(fading_s)))
        return ErrorModel(_UNKNOWN_V, correlation)
    band = prediction_band(model, run, initial_soc, uncertainty)
    level_V = float(np.sqrt(np.nanmean(band.std_V**2)))
    return ErrorModel(max(level_V, _LEAST_V), uncertainty.correlation)


def seen_error_model(errors_V: Sequence[FloatArray]) -> ErrorModel:
    """Expected error as long runs show it themselves, from the best starts that are known."""
    error_V = np.concatenate(errors_V)
    known = error_V[~np.isnan(error_V)]
    starts = np.concatenate([[0], np.cumsum([len(each) for each in errors_V])[:-1]])
    return ErrorModel(max(float(np.sqrt(np.mean(known**2))), _LEAST_V), fit_correlation(error_V, starts))


def whitener(known: np.ndarray, expected: ErrorModel) -> Whitener:
    """Spans of a run and what makes their means white.

    Parameters
    ----------
    known : (n,) where a voltage was measured
    expected : error on these samples
    """
    first, end = _spans(len(known))
    count = np.add.reduceat(known.astype(np.int64), first)
    kept = count > 0
    first, end, count = first[kept], end[kept], count[kept]
    covariance = _covariance(first, end, count, expected.correlation) + _ALL_ALONG * (1.0 - expected.correlation.white)
    covariance *= expected.level_V**2
    root = np.linalg.cholesky(covariance + 1e-12 * np.trace(covariance) / len(first) * np.eye(len(first)))
    return Whitener(first, end, known, np.linalg.inv(root))


def _spans(n: int) -> tuple[np.ndarray, np.ndarray]:
    edges = [0]
    while edges[-1] < n:
        edges.append(min(n, edges[-1] + max(1, int(min(_GROWTH * edges[-1], n / _SPANS)))))
    return np.array(edges[:-1]), np.array(edges[1:])


def _covariance(first: np.ndarray, end: np.ndarray, count: np.ndarray, correlation: ResidualCorrelation) -> FloatArray:
    """(m, m) covariance of the means over spans of an error of variance 1."""
    n = (end - first).astype(np.float64)
    out = np.diag(correlation.white / count)
    gap = np.maximum(first[None, :] - end[:, None] + 1, 0).astype(np.float64)
    after = np.triu(np.ones((len(n), len(n)), dtype=bool), 1)
    for share, keep in zip(correlation.shares, correlation.keep, strict=True):
        # Sum of keep^i over a span, over its length; and the double sum within a span.
        edge = (1.0 - keep**n) / ((1.0 - keep) * n)
        within = (n * (1.0 - keep**2) - 2.0 * keep * (1.0 - keep**n)) / ((1.0 - keep) ** 2 * n**2)
        between = np.where(after, edge[:, None] * keep**gap * edge[None, :], 0.0)
        out += share * (np.diag(within) + between + between.T)
    return out
