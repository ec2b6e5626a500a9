"""How far the cell's voltage may lie from its prediction, for a whole sequence at once."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from scipy.linalg import cho_factor, solve_triangular
from scipy.stats import chi2, norm

from models.design.experiment import Experiment, Prediction
from models.local_model_network import LocalModelNetwork
from models.prediction_band import prediction_band
from models.resampling import GridRun
from models.timeseries import FloatArray
from models.uncertainty import Uncertainty, uncertainty_of

CONFIDENCE = 0.997
# A run that the model has not seen finds larger errors than the largest so far. Less is added where that was found on
# runs that the fit had not seen either.
_HELD_OUT_FACTOR, _TRAINED_FACTOR = 1.2, 1.4
_LEAST_SCALE = 3.0


class Band(Protocol):
    """Half width of the voltage's band in a sequence."""

    def width_V(self, experiment: Experiment, current_A: FloatArray, prediction: Prediction) -> FloatArray:
        """(N,) in V, for all samples of the sequence at once."""
        ...


@dataclass(frozen=True)
class VoltageBand:
    """A constant error of the structure, and that of the parameters.

    Attributes
    ----------
    error_V : largest error of the model's structure: what parameters, however well known, do not remove
    information : (M p, M p) on the parameters, or None where their error is part of `error_V`
    confidence : probability with which all samples lie inside

    Notes
    -----
    The share of the parameters is Scheffe's band: sqrt(chi2_P) times the standard deviation of each prediction holds
    for every linear combination of the parameters at once, and so for every sample of every sequence (Scheffe,
    Biometrika 40, 1953).
    """

    error_V: float
    information: FloatArray | None = field(default=None, repr=False)
    confidence: float = CONFIDENCE

    def width_V(self, experiment: Experiment, current_A: FloatArray, prediction: Prediction) -> FloatArray:
        """(N,) in V."""
        if self.information is None:
            return np.full(len(current_A), self.error_V)
        factor, _ = cho_factor(self.information, lower=True)
        spread = solve_triangular(factor, prediction.sensitivity_V.T, lower=True, check_finite=False)
        scale = np.sqrt(chi2.ppf(self.confidence, self.information.shape[0]))
        return self.error_V + scale * np.sqrt((spread**2).sum(axis=0))


@dataclass(frozen=True)
class LearntBand:
    """The network's own pointwise uncertainty, widened until it holds for all samples at once.

    Attributes
    ----------
    uncertainty : of the network: parameters, held-out error, distance from the trained domain
    largest_over_rms : largest error over the root mean square one that is expected of a whole run, from the runs known
        so far; None: Bonferroni's bound over the samples of a normal error
    confidence : probability with which all samples lie inside, for Bonferroni's bound
    """

    uncertainty: Uncertainty
    largest_over_rms: float | None = None
    confidence: float = CONFIDENCE

    def width_V(self, experiment: Experiment, current_A: FloatArray, prediction: Prediction) -> FloatArray:
        """(N,) in V."""
        run = planned_run(experiment, current_A)
        pointwise = prediction_band(experiment.network, run, experiment.initial_soc, self.uncertainty).std_V
        scale = self.largest_over_rms
        if scale is None:
            scale = float(norm.isf((1.0 - self.confidence) / (2.0 * len(current_A))))
        return max(scale, _LEAST_SCALE) * pointwise[experiment.lead :]


def recorded_band(network: LocalModelNetwork) -> Band:
    """Band from what a network's record says of its errors."""
    held_out = network.record.get("validation")
    figures = held_out or network.record.get("train") or {}
    factor = _HELD_OUT_FACTOR if held_out else _TRAINED_FACTOR
    largest_mV, rms_mV = float(figures.get("max_mV", 0.0)), float(figures.get("rmse_mV", 0.0))
    uncertainty = uncertainty_of(network)
    if uncertainty is None:
        return VoltageBand(factor * 1e-3 * largest_mV)
    return LearntBand(uncertainty, factor * largest_mV / rms_mV if rms_mV > 0.0 else None)


def planned_run(experiment: Experiment, current_A: FloatArray) -> GridRun:
    """Run that a current would give, with the samples at rest before it and without a voltage."""
    network = experiment.network
    dt_s, n = network.structure.dt_s, len(current_A) + experiment.lead
    current = np.concatenate([np.zeros(experiment.lead), current_A])
    return GridRun(
        name="planned",
        dt_s=dt_s,
        time_s=dt_s * np.arange(n),
        current_A=current,
        voltage_V=np.full(n, np.nan),
        temperature_degC=np.full(n, experiment.temperature_degC),
        ambient_degC=np.full(n, experiment.temperature_degC),
        charge_Ah=np.cumsum(current) * dt_s / 3600.0,
        soc_ref=None,
        segment_starts=(0,),
        measured=np.zeros(n, dtype=bool),
    )
