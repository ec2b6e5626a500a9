"""How far the cell's voltage may lie from its prediction, for a whole sequence at once."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.linalg import cho_factor, solve_triangular
from scipy.special import gammaincinv

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.design.information.experiment import Experiment, Prediction
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import parse_signal
from models.uncertainty.bands import prediction_band
from models.uncertainty.model_uncertainty import Uncertainty, uncertainty_of
from models.uncertainty.spread import LocalFactor

CONFIDENCE = 0.997
# A run that the model has not seen finds larger errors than the largest so far. Less is added where that was found on
# runs that the fit had not seen either.
_HELD_OUT_FACTOR, _TRAINED_FACTOR = 1.2, 1.4
# Of Laplace's distribution, over its standard deviation: what 95 % keep, and over how much a further one in e is left.
_BEYOND = 0.05
_LAPLACE_FALL = float(np.sqrt(0.5))
_LAPLACE_P95 = -_LAPLACE_FALL * float(np.log(_BEYOND))
# How rarely the largest error so far may be as small as it is, and the fewest beyond the 95 % that tell anything.
_UNLUCKY, _FEWEST_BEYOND = 0.025, 8.0
# Colder by less is as good as the same: a cell's overvoltages grow by a few percent per kelvin.
_COLDER_K = 1.0


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
        scale = np.sqrt(2.0 * gammaincinv(0.5 * self.information.shape[0], self.confidence))
        return self.error_V + scale * np.sqrt((spread**2).sum(axis=0))


@dataclass(frozen=True)
class Tail:
    """Errors of runs that are known already, over their root mean square.

    Attributes
    ----------
    p95, largest : 95 % of the errors lie within the first, all within the second
    n_samples : of those runs
    """

    p95: float
    largest: float
    n_samples: int


@dataclass(frozen=True)
class LearntBand:
    """The network's own pointwise uncertainty, widened until it holds for all samples at once.

    Attributes
    ----------
    uncertainty : of the network: parameters, held-out error, distance from the trained domain
    tail : of the errors of the runs known so far; None: not known
    confidence : probability with which all samples lie inside

    Notes
    -----
    Errors of a structure have heavier tails than a normal distribution. The largest one so far says little about that
    of the next run: it is a single draw of an extreme. So beyond what 95 % of the errors keep, their number is taken to
    fall exponentially, as Laplace's distribution does, or faster where the largest of the runs so far would otherwise
    have been larger in 97.5 of 100 cases (the peaks over a threshold: Coles, "An Introduction to Statistical Modeling
    of Extreme Values", 2001, ch. 4). What counts is not the number of samples but how often the error crosses its
    middle in a sequence of N: N arccos(r) / pi times, with r its autocorrelation from one sample to the next (Rice,
    Bell System Technical Journal 24, 1945, for a sampled process). Twice that many are counted: exact for errors
    without memory, of which each sample is one draw, and on the safe side for slow ones.
    """

    uncertainty: Uncertainty
    tail: Tail | None = None
    confidence: float = CONFIDENCE

    def width_V(self, experiment: Experiment, current_A: FloatArray, prediction: Prediction) -> FloatArray:
        """(N,) in V."""
        run, soc = planned_run(experiment, current_A), experiment.initial_soc
        pointwise = prediction_band(experiment.network, run, soc, self.uncertainty, self._local).std_V
        width_V = self.scale(len(current_A)) * pointwise[experiment.lead :]
        return width_V + colder_V(experiment, current_A, prediction)

    @cached_property
    def _local(self) -> LocalFactor:
        """Factor of the parameters' covariance, with what of it was needed so far."""
        return LocalFactor(self.uncertainty.parameters.theta_factor)

    def scale(self, n_samples: int) -> float:
        """Standard deviations within which all samples of a sequence lie."""
        threshold, fall, least = _LAPLACE_P95, _LAPLACE_FALL, 0.0
        if self.tail is not None:
            threshold, least = self.tail.p95, self.tail.largest
            beyond = _BEYOND * self._draws(self.tail.n_samples)
            if beyond > _FEWEST_BEYOND:
                fall = min(fall, (least - threshold) / float(np.log(beyond / -np.log(_UNLUCKY))))
        beyond = max(_BEYOND * self._draws(n_samples), 1.0)
        return max(threshold + fall * float(np.log(beyond / (1.0 - self.confidence))), least)

    def _draws(self, n_samples: int) -> float:
        """Errors in a sequence that count as drawn one by one."""
        neighbour = float(self.uncertainty.correlation.at(np.ones(1))[0])
        return max(1.0, 2.0 / np.pi * n_samples * float(np.arccos(np.clip(neighbour, 0.0, 1.0))))


def colder_V(experiment: Experiment, current_A: FloatArray, prediction: Prediction) -> FloatArray:
    """(N,) by how much the voltage differs where the cell is as cold as it may be.

    That is no scatter about the prediction but lasts as long as the cell is cold, and a cell begins a run colder than
    it was in the middle of those that the model was made from. A warmer one has smaller overvoltages, which is on the
    safe side of a limit.
    """
    network, coldest_degC = experiment.network, experiment.coldest_degC
    signals = map(parse_signal, network.structure.signals)
    if coldest_degC is None or not any(signal.depends_on_temperature for signal in signals):
        return np.zeros(len(current_A))
    run = planned_run(replace(experiment, temperature_degC=coldest_degC), current_A)
    cold_V = free_run_V(network, run, experiment.initial_soc)[experiment.lead :]
    return np.abs(cold_V - prediction.voltage_V)


def colder_words(experiment: Experiment) -> str:
    """What to do about a cell that may be colder than it is predicted at, in words that go on; empty: it is not."""
    if experiment.coldest_degC is None or experiment.coldest_degC > experiment.temperature_degC - _COLDER_K:
        return ""
    return f", or state ambient_degC: the cell is taken to be as cold as {experiment.coldest_degC:.1f} degC"


def recorded_band(network: LocalModelNetwork) -> Band:
    """Band from what a network's record says of its errors."""
    held_out = network.record.validation
    figures = held_out or network.record.train or {}
    largest_mV, rms_mV = float(figures.get("max_mV", 0.0)), float(figures.get("rmse_mV", 0.0))
    uncertainty = uncertainty_of(network)
    if uncertainty is None:
        return VoltageBand(1e-3 * (_HELD_OUT_FACTOR if held_out else _TRAINED_FACTOR) * largest_mV)
    if not rms_mV > 0.0:
        return LearntBand(uncertainty)
    return LearntBand(uncertainty, Tail(figures["p95_mV"] / rms_mV, largest_mV / rms_mV, int(figures["n_samples"])))


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
