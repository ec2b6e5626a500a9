"""Freeing the poles of the local models, as far as held-out samples support it."""

from __future__ import annotations

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


def refined_theta(fitted: Fitted, progress: Progress) -> tuple[FloatArray, dict[str, Any]]:
    """Refine a shared-pole fit where that helps on samples that the refinement does not see.

    Parameters
    ----------
    fitted : the shared-pole fit
    progress : called with a share 0..1 and a short text

    Returns
    -------
    (M, p) parameters, and what was tried: held-out RMSE in mV without and with each pull towards the start. The
    result is the shared-pole fit itself where no refinement lowered the held-out error.
    """
    order = fitted.structure.output_order
    if order == 0:
        return fitted.theta, {"chosen": None, "reason": "no past outputs: the shared-pole fit is the optimum"}
    with threadpool_limits(1, user_api="blas"):
        errors = _held_out_errors(fitted, progress)
    tried = {("none" if pull is None else f"{pull:g}"): error for pull, error in errors.items()}
    best = min(errors, key=errors.__getitem__)
    base = errors[None]
    if best is None or errors[best] > base * (1.0 - _WORTH):
        return fitted.theta, {"chosen": None, "held_out_rmse_mV": tried}
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
    return result.theta, {"chosen": best, "held_out_rmse_mV": tried, "iterations": result.iterations}


def _held_out_errors(fitted: Fitted, progress: Progress) -> dict[float | None, float]:
    """Held-out RMSE in mV for each pull towards the start; None stands for no refinement."""
    data, order = fitted.data, fitted.structure.output_order
    group = groups(data)
    validity = fitted.partition.validity(data.z)
    squares: dict[float | None, float] = dict.fromkeys([None, *_TOWARDS_START], 0.0)
    count = 0
    for number, held_groups in enumerate(folds(len(fitted.sums.count))[:_TRIAL_FOLDS]):
        held = np.isin(group, held_groups)
        judged = held & ~np.isnan(data.y)
        count += int(judged.sum())
        b = solve_without(fitted.sums, fitted.fit.penalty, held_groups)
        start = full_theta(fitted.a, b, fitted.partition.n_models)
        share = 1.0 - held.mean()
        for i, pull in enumerate(squares):
            progress((number + i / len(squares)) / _TRIAL_FOLDS * 0.7, "freeing the local poles on trial")
            theta = start
            if pull is not None:
                theta = refine(
                    start,
                    order,
                    fitted.partition,
                    data,
                    share * fitted.fit.penalty,
                    pull,
                    weights=(~held).astype(np.float64),
                    max_iterations=_TRIAL_ITERATIONS,
                ).theta
            error = (free_run(theta, order, validity, data) - data.y)[judged]
            squares[pull] += float(error @ error)
    span_mV = 1e3 * span_V(fitted.scaling)
    return {pull: float(np.sqrt(total / max(count, 1))) * span_mV for pull, total in squares.items()}
