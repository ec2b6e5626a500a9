"""Learning what a network does not know from errors on training samples that were held out.

Training residuals will not do: a flexible model makes them as small as it likes.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular
from threadpoolctl import threadpool_limits

from models.data.timeseries import FloatArray
from models.identification.search.fitted import Fitted, full_theta, span_V
from models.identification.shared_poles import solve_without
from models.network.folds import folds
from models.network.penalty import Penalty
from models.network.recursion import free_run, initial_samples
from models.uncertainty.bands import NORMAL_95, parameter_variance, sensitivities
from models.uncertainty.correlation import ResidualCorrelation, fit_correlation
from models.uncertainty.covariance import ParameterCovariance, parameter_covariance
from models.uncertainty.model_uncertainty import Uncertainty

# A local model with fewer own samples for each parameter than construction asks for is thin; so is one whose parameters
# may be wrong by more than its residual level.
_SAMPLES_PER_PARAMETER = 8.0
# A local level leans on that of all samples as if so many independent samples of it had been seen.
_PRIOR_SAMPLES = 10.0


def fit_uncertainty(
    fitted: Fitted, theta: FloatArray, penalties: list[Penalty] | None = None, held_out: FloatArray | None = None
) -> Uncertainty:
    """Learn what a network does not know.

    Parameters
    ----------
    fitted : the shared-pole fit that it comes from
    theta : (M, p) final parameters
    penalties : of the refinement; None: there was none
    held_out : (N,) error of refined fits on samples that they did not see (measured minus simulated, normalised), NaN
        elsewhere; by default that of shared-pole fits
    """
    order, data = fitted.structure.output_order, fitted.data
    validity = fitted.partition.validity(data.z)
    with threadpool_limits(1, user_api="blas"):
        error = held_out_error(fitted, validity) if held_out is None else held_out
        growth = _growth(fitted, validity)
    known = ~np.isnan(error)
    near, squared = validity[known], error[known] ** 2
    independent = near.sum(axis=0) / fit_correlation(error, data.starts).inflation
    seen = (data.y - free_run(theta, order, validity, data))[known] ** 2
    least = _local_mean(near, seen, independent)

    def level2(of_parameters: FloatArray) -> FloatArray:
        # Held-out error is noise, structure and the error of the parameters: the last does not belong to the level.
        return np.maximum(_local_mean(near, squared - of_parameters, independent), least)

    first, _ = _parameters(fitted, theta, np.sqrt(validity @ level2(np.zeros(len(squared)))), error, penalties)
    too_much = (growth * parameter_variance(first, theta, order, validity, data))[known]
    parameters, correlation = _parameters(fitted, theta, np.sqrt(validity @ level2(too_much)), error, penalties)
    now = parameter_variance(parameters, theta, order, validity, data)[known]
    of_parameters = growth[known] * now
    level = level2(of_parameters)
    ratio = np.sqrt(squared / (of_parameters + near @ level))
    own = np.bincount(validity[~np.isnan(data.y)].argmax(axis=1), minlength=fitted.partition.n_models)
    few = own < _SAMPLES_PER_PARAMETER * data.u.shape[1]
    loose = near.T @ now > near.sum(axis=0) * level
    return Uncertainty(
        parameters=parameters,
        level_V=span_V(fitted.scaling) * np.sqrt(level),
        samples=own.astype(np.float64),
        effective_samples=own / correlation.inflation,
        thin=few | loose,
        band_factor=max(1.0, float(np.percentile(ratio, 95.0)) / NORMAL_95),
        correlation=correlation.between(fitted.data.keep_every),
    )


def _parameters(
    fitted: Fitted, theta: FloatArray, level: FloatArray, error: FloatArray, penalties: list[Penalty] | None
) -> tuple[ParameterCovariance, ResidualCorrelation]:
    correlation = fit_correlation(error / level, fitted.data.starts)
    parameters = parameter_covariance(
        theta,
        fitted.structure.output_order,
        fitted.partition,
        fitted.data,
        level=level,
        correlation=correlation,
        penalties=[Penalty(fitted.fit.penalty, fitted.fit.b)] if penalties is None else penalties,
        shared=penalties is None,
    )
    return parameters, correlation


def _local_mean(weight: FloatArray, values: FloatArray, independent: FloatArray) -> FloatArray:
    """(M,) mean near each local model, leaning on the overall mean where few independent samples are."""
    local = weight.T @ values / np.maximum(weight.sum(axis=0), 1e-300)
    return (independent * local + _PRIOR_SAMPLES * float(values.mean())) / (independent + _PRIOR_SAMPLES)


def _growth(fitted: Fitted, validity: FloatArray) -> FloatArray:
    """(N,) by how much the parameters' variance at a sample is larger for the fit that did not see it."""
    data, order, sums = fitted.data, fitted.structure.output_order, fitted.sums
    group, n_models = data.groups(), fitted.partition.n_models
    whole = np.linalg.cholesky(_regular(sums.xx.sum(axis=0), fitted.fit.penalty))
    out, roots = np.ones(len(data)), {}
    for held in folds(len(sums.count)):
        kept = np.setdiff1d(np.arange(len(sums.count)), held)
        share = sums.count[kept].sum() / max(sums.count.sum(), 1.0)
        root = np.linalg.cholesky(_regular(sums.xx[kept].sum(axis=0), share * fitted.fit.penalty))
        roots |= dict.fromkeys(held.tolist(), root)
    for part, rows in sensitivities(fitted.theta, order, validity, data):
        x = rows.reshape(len(rows), n_models, -1)[:, :, order:].reshape(len(rows), -1)
        base = np.sum(solve_triangular(whole, x.T, lower=True) ** 2, axis=0)
        for g in np.unique(group[part]):
            chosen = group[part] == g
            apart = np.sum(solve_triangular(roots[int(g)], x[chosen].T, lower=True) ** 2, axis=0)
            out[part.start + np.flatnonzero(chosen)] = apart / np.maximum(base[chosen], 1e-300)
    return np.maximum(out, 1.0)


def _regular(information: FloatArray, penalty: FloatArray) -> FloatArray:
    size = len(information)
    return information + penalty + 1e-10 * np.trace(information) / size * np.eye(size)


def held_out_error(fitted: Fitted, validity: FloatArray, fold: np.ndarray | None = None) -> FloatArray:
    """(N,) free-run error (measured minus simulated, normalised) of each sample by a fit that did not see it.

    NaN where no voltage was measured or an initial value stands. Poles and penalties are those of the whole fit.

    Parameters
    ----------
    fitted : the shared-pole fit
    validity : (N, M)
    fold : (N,) number of the fold of each sample, of which each holds whole groups; by default as `folds` has them
    """
    data, order = fitted.data, fitted.structure.output_order
    group = data.groups()
    error = np.full(len(data), np.nan)
    sets = folds(len(fitted.sums.count))
    if fold is not None:
        sets = [np.unique(group[fold == number]) for number in np.unique(fold)]
    for held_groups in sets:
        b = solve_without(fitted.sums, fitted.fit.penalty, held_groups)
        simulated = free_run(full_theta(fitted.a, b, fitted.partition.n_models), order, validity, data)
        held = np.isin(group, held_groups)
        error[held] = (data.y - simulated)[held]
    error[initial_samples(len(data), data.starts, order) > 0] = np.nan
    return error
