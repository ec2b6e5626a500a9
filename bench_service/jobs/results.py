"""What jobs give back: JSON objects, those of the public contract among them.

A MODEL.json is a `Document`: only `models` knows its shape.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NotRequired, TypedDict

import numpy as np
from numpy.typing import NDArray

Document = dict[str, Any]


class Metrics(TypedDict):
    """Errors of a free run."""

    rmse_mV: float
    mae_mV: float
    p95_mV: float
    max_mV: float
    bias_mV: float
    nrmse: float
    n_samples: int


class FitMetrics(TypedDict):
    """What a fit is worth; ``compared``: the kinds of networks that were tried, ``terms``: what a bounded one has."""

    structure: str
    n_samples: int
    n_local_models: int
    seconds: float
    train: Metrics
    validation: Metrics | None
    expected_rmse_mV: float
    compared: list[dict[str, Any]]
    terms: list[dict[str, Any]]
    usability: dict[str, Any] | None
    runs: dict[str, list[dict[str, Any]]]


class FitResult(TypedDict):
    """A new model."""

    document: Document
    metrics: FitMetrics


class FitAnswer(TypedDict):
    """What is told of a fit once its model is stored."""

    model_id: str
    metrics: FitMetrics


class ErrorPair(TypedDict):
    """Errors of two versions on the same samples; None where there are none."""

    before_mV: float | None
    after_mV: float | None


class VersionMetrics(TypedDict):
    """What a further version of a model is worth on runs that it never saw; ``effect`` is None after a mere refit.

    ``inside`` and ``outside``: the errors apart, by the ranges that the version before it was trained in.
    """

    effect: str | None
    error_before_mV: float
    error_after_mV: float
    inside: ErrorPair
    outside: ErrorPair
    parameters: dict[str, Any]
    remark: str
    usability: dict[str, Any] | None
    noise_floor_mV: float | None


class VersionResult(TypedDict):
    """A further version of a model."""

    document: Document
    structure: str
    capacity_Ah: float
    metrics: VersionMetrics


class VersionAnswer(VersionMetrics):
    """What is told of a further version once it is stored: ids of it and of the one that it comes from."""

    model: str
    parent: str


class DesignResult(TypedDict):
    """A designed profile, forward hold; ``figures`` are the ``design`` object of the public contract.

    ``page`` is its report, where one was wanted.
    """

    time_s: list[float]
    current_A: list[float]
    figures: dict[str, Any]
    page: NotRequired[bytes | None]


class DesignAnswer(TypedDict):
    """What is told of a design once its profile is stored."""

    profile_id: str
    name: str
    figures: dict[str, Any]


class ComparisonResult(TypedDict):
    """The ``compare`` object of the public contract."""

    overall: Metrics
    expected_rmse_mV: float | None
    overall_fitted_start: Metrics
    runs: list[dict[str, Any]]
    noise_floor_mV: float | None
    where: list[dict[str, Any]]
    outside_training: float
    temperature: dict[str, Any] | None
    usability: dict[str, Any] | None
    baselines: NotRequired[list[dict[str, Any]]]


class SocFigures(TypedDict):
    """How well an observer followed the counted state of charge."""

    soc_rmse: float
    soc_max_error: float
    soc_end_error: float
    converged_after_s: float | None
    coverage_95: float


@dataclass(frozen=True, slots=True)
class Curves:
    """Curves of one run on the model's grid.

    Attributes
    ----------
    time_s : ndarray, shape (n,)
        From the run's start.
    columns : dict of str to ndarray, shape (n,)
        ``measured_V``, ``model_V`` and ``residual_mV`` (measured minus model); NaN where a value is missing.
    """

    run_id: str
    time_s: NDArray[np.float64]
    columns: Mapping[str, NDArray[Any]]
