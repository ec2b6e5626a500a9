"""Freeing the poles of the local models, as far as held-out samples support it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from models.data.timeseries import FloatArray
from models.identification.output_error import HeldOutChoice, refine
from models.identification.progress import Progress
from models.identification.search.fitted import Fitted, full_theta, span_V
from models.identification.shared_poles import penalties, solve_without
from models.network.folds import N_FOLDS, folds
from models.network.penalty import Penalty
from models.network.recursion import free_run, initial_samples

# Refinement must lower the held-out error by this share, or the shared-pole solution stays.
_WORTH = 0.01
_MOST_ITERATIONS = 20


class RefinementRecord(TypedDict, total=False):
    """What was tried, for the model's record; `chosen`: strength of the pull of the poles, or None."""

    chosen: float | None
    reason: str
    held_out_rmse_mV: dict[str, float]
    iterations: int
    log_strengths: list[float]


@dataclass(frozen=True)
class Refined:
    """Parameters after refinement, or the shared-pole ones where it did not help.

    Attributes
    ----------
    theta : (M, p)
    record : what was tried: held-out RMSE in mV without and with refinement, and the strengths of its penalties
    penalties : that were added to the information; None: the result is the shared-pole fit itself
    held_out : (N,) measured minus simulated, normalised, of refined parameters on samples that they did not see; None
        without refinement
    """

    theta: FloatArray
    record: RefinementRecord
    penalties: list[Penalty] | None = None
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
    data, partition = fitted.data, fitted.partition
    fold, forms = data.groups() % N_FOLDS, penalties(fitted.structure, partition, data, fitted.a)
    result = refine(
        fitted.theta,
        order,
        partition,
        data,
        HeldOutChoice(forms, fold, fitted.fit.log_strengths),
        max_iterations=_MOST_ITERATIONS,
        on_iteration=lambda step, rmse: progress(0.9 * step / _MOST_ITERATIONS, f"freeing the poles, step {step}"),
    )
    progress(0.9, "comparing on held-out samples")
    shared = [
        full_theta(fitted.a, solve_without(fitted.sums, fitted.fit.penalty, held), partition.n_models)
        for held in folds(len(fitted.sums.count))
    ]
    before, after = (_held_out(fitted, fold, without) for without in (shared, result.without))
    errors_mV = {"none": _rmse_mV(fitted, before), "refined": _rmse_mV(fitted, after)}
    record: RefinementRecord = {"held_out_rmse_mV": errors_mV, "iterations": result.iterations}
    if not errors_mV["refined"] < errors_mV["none"] * (1.0 - _WORTH):
        return Refined(fitted.theta, {**record, "chosen": None})
    strengths = list(result.log_strengths)
    record = {**record, "chosen": 10.0 ** strengths[-1], "log_strengths": strengths}
    return Refined(result.theta, record, result.penalties, after)


def _held_out(fitted: Fitted, fold: np.ndarray, without: list[FloatArray]) -> FloatArray:
    """(N,) measured minus simulated, each sample by parameters that its fold had no part in."""
    data, order = fitted.data, fitted.structure.output_order
    validity, residual = fitted.partition.validity(data.z), np.full(len(data), np.nan)
    for number, theta in enumerate(without):
        held = fold == number
        residual[held] = (data.y - free_run(theta, order, validity, data))[held]
    residual[initial_samples(len(data), data.starts, order) > 0] = np.nan
    return residual


def _rmse_mV(fitted: Fitted, residual: FloatArray) -> float:
    known = residual[~np.isnan(residual)]
    return float(np.sqrt(known @ known / max(len(known), 1))) * 1e3 * span_V(fitted.scaling)
