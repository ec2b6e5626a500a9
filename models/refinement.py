"""Freeing the poles of the local models, as far as held-out samples support it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from models.holdout import folds, groups
from models.local_model_network import free_run
from models.output_error import refine
from models.shared_poles import solve_without
from models.structure_search import Fitted, Progress, full_theta, span_V
from models.timeseries import FloatArray

# Pulls towards the shared-pole solution that are tried, from strong to weak.
_TOWARDS_START = (1e-1, 1e-2, 1e-3)
_TRIAL_FOLDS = 2
_TRIAL_ITERATIONS = 6
_FINAL_ITERATIONS = 20
# Refinement must lower the held-out error by this share, or the shared-pole solution stays.
_WORTH = 0.01


@dataclass(frozen=True)
class Refined:
    """Parameters after refinement, or the shared-pole ones where it did not help.

    Attributes
    ----------
    theta : (M, p)
    record : what was tried: held-out RMSE in mV without and with each pull towards the start
    pull : the one chosen; None: the result is the shared-pole fit itself
    held_out : (N,) measured minus simulated, normalised, of trial refinements on samples that they did not see, NaN
        elsewhere; None without refinement
    """

    theta: FloatArray
    record: dict[str, Any]
    pull: float | None = None
    held_out: FloatArray | None = None


def refined_theta(fitted: Fitted, progress: Progress) -> Refined:
    """Refine a shared-pole fit where that helps on samples that the refinement does not see.

    Parameters
    ----------
    fitted : the shared-pole fit
    progress : called with a share 0..1 and a short text

    Returns
    -------
    Refined
        The shared-pole fit itself where no refinement lowered the held-out error.
    """
    order = fitted.structure.output_order
    if order == 0:
        reason = "no past outputs: the shared-pole fit is the optimum"
        return Refined(fitted.theta, {"chosen": None, "reason": reason})
    with threadpool_limits(1, user_api="blas"):
        residuals = _held_out_residuals(fitted, progress)
    errors = {pull: _rmse_mV(fitted, residual) for pull, residual in residuals.items()}
    tried = {("none" if pull is None else f"{pull:g}"): error for pull, error in errors.items()}
    best = min(errors, key=errors.__getitem__)
    base = errors[None]
    if best is None or errors[best] > base * (1.0 - _WORTH):
        return Refined(fitted.theta, {"chosen": None, "held_out_rmse_mV": tried})
    progress(0.7, "refining on the free run")
    result = refine(
        fitted.theta,
        order,
        fitted.partition,
        fitted.data,
        fitted.fit.penalty,
        best,
        max_iterations=_FINAL_ITERATIONS,
        on_iteration=lambda step, rmse: progress(0.7 + 0.3 * step / _FINAL_ITERATIONS, f"refining, step {step}"),
    )
    record = {"chosen": best, "held_out_rmse_mV": tried, "iterations": result.iterations}
    return Refined(result.theta, record, best, residuals[best])


def _rmse_mV(fitted: Fitted, residual: FloatArray) -> float:
    known = residual[~np.isnan(residual)]
    return float(np.sqrt(known @ known / max(len(known), 1))) * 1e3 * span_V(fitted.scaling)


def _held_out_residuals(fitted: Fitted, progress: Progress) -> dict[float | None, FloatArray]:
    """Measured minus simulated on held-out samples for each pull towards the start; None: no refinement."""
    data, order = fitted.data, fitted.structure.output_order
    group = groups(data)
    validity = fitted.partition.validity(data.z)
    trials = [np.isin(group, held_groups) for held_groups in folds(len(fitted.sums.count))[:_TRIAL_FOLDS]]
    starts = []
    for held_groups in folds(len(fitted.sums.count))[:_TRIAL_FOLDS]:
        b = solve_without(fitted.sums, fitted.fit.penalty, held_groups)
        starts.append(full_theta(fitted.a, b, fitted.partition.n_models))
    residuals: dict[float | None, FloatArray] = {}
    for number, pull in enumerate((None, *_TOWARDS_START)):
        progress(0.7 * number / (1 + len(_TOWARDS_START)), "freeing the local poles on trial")
        residual = np.full(len(data), np.nan)
        for held, start in zip(trials, starts, strict=True):
            theta = start if pull is None else _trial(fitted, start, pull, held)
            residual[held] = (data.y - free_run(theta, order, validity, data))[held]
        residuals[pull] = residual
    return residuals


def _trial(fitted: Fitted, start: FloatArray, pull: float, held: np.ndarray) -> FloatArray:
    """Refine without the held-out samples."""
    return refine(
        start,
        fitted.structure.output_order,
        fitted.partition,
        fitted.data,
        (1.0 - held.mean()) * fitted.fit.penalty,
        pull,
        weights=(~held).astype(np.float64),
        max_iterations=_TRIAL_ITERATIONS,
    ).theta
