"""An experiment that is still to be made: what a current would tell about a network, and how to make it tell more."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.design.information.active_models import MarginalPrior, add_products, picked, spread_out, times_block
from models.design.information.criteria import CRITERIA, inverse_of
from models.design.information.sensitivity_path import sensitivities, signal_gradient
from models.design.information.signal_path import current_gradient, signal_values
from models.network.compiled_network import flat_network
from models.network.local_model_network import LocalModelNetwork
from models.uncertainty.correlation import ResidualCorrelation

SENSITIVITIES = ("free_run", "one_step")
DEFAULT_TEMPERATURE_DEGC = 25.0
# What tests tell most about changes as slowly as this.
_MIDDLE_S = 60.0


@dataclass(frozen=True)
class Experiment:
    """What is to be learnt about which network, from where.

    Attributes
    ----------
    network : reference model, whose parameters the experiment is to tell
    initial_soc : fraction, the cell at rest
    noise_V : standard deviation of the voltage that the fit cannot explain
    temperature_degC : of the cell, throughout
    coldest_degC : as cold as the cell may be, where that is not known; None: as warm as `temperature_degC` at the least
    sensitivity : "free_run" or "one_step". Free run is the default: the bench's noise sits on the measured voltage, not
        in the cell's own past, and the network is fitted and judged by its free run. One-step is the method's
        (eq. 2.9), with past outputs that are simulated but taken as known.
    prior : (M p, M p) information that is there already; without it each parameter, which is of the order of 1 in
        normalised units, is taken as known to `prior_std`
    prior_std : see `prior`
    predictor : predicts the voltage, where `network` is a coarse copy of it; None: `network` does
    memory : how what the fit cannot explain hangs together in time; None: it is white
    level_V : (M,) its standard deviation near each local model; None: `noise_V` everywhere
    """

    network: LocalModelNetwork
    initial_soc: float
    noise_V: float
    temperature_degC: float = DEFAULT_TEMPERATURE_DEGC
    sensitivity: str = SENSITIVITIES[0]
    prior: FloatArray | None = field(default=None, repr=False)
    prior_std: float = 1.0
    predictor: LocalModelNetwork | None = field(default=None, repr=False)
    memory: ResidualCorrelation | None = field(default=None, repr=False)
    level_V: FloatArray | None = field(default=None, repr=False)
    coldest_degC: float | None = None

    def __post_init__(self) -> None:
        """Check ranges."""
        if self.sensitivity not in SENSITIVITIES:
            raise ModelError(f"sensitivity {self.sensitivity!r} is unknown; use one of {', '.join(SENSITIVITIES)}")
        if not (np.isfinite(self.noise_V) and self.noise_V > 0.0):
            raise ModelError(f"noise is {self.noise_V:g} V; its standard deviation must be positive")
        if not (np.isfinite(self.prior_std) and self.prior_std > 0.0):
            raise ModelError(f"prior standard deviation is {self.prior_std:g}; it must be positive")
        size = self.network.theta.size
        if self.prior is not None and self.prior.shape != (size, size):
            raise ModelError(f"prior information has shape {self.prior.shape}; the network has {size} parameters")

    @property
    def predicted(self) -> Experiment:
        """The same with the network that predicts its voltage, of whose parameters nothing is asked."""
        if self.predictor is None:
            return self
        bare = replace(self, prior=None, level_V=None, sensitivity=SENSITIVITIES[0])
        return replace(bare, network=self.predictor, predictor=None)

    @property
    def working_V(self) -> float:
        """Standard deviation of white noise that leaves as much unknown of what changes within a minute."""
        if self.memory is None:
            return self.noise_V
        fade = float(np.exp(-self.network.structure.dt_s / _MIDDLE_S)) * self.memory.keep
        worth = self.memory.white + float(self.memory.shares @ ((1.0 + fade) / (1.0 - fade)))
        return self.noise_V * float(np.sqrt(worth))

    @property
    def lead(self) -> int:
        """Samples at rest before the current begins: they hold the initial values."""
        return max(self.network.structure.output_order, 1)

    def prior_information(self) -> FloatArray:
        """(M p, M p) information that is there before the experiment."""
        size = self.network.theta.size
        return self.prior if self.prior is not None else np.eye(size) / self.prior_std**2


@dataclass(frozen=True)
class Prediction:
    """What the reference model expects of a current.

    Attributes
    ----------
    voltage_V, soc : (N,) at the end of each current's interval
    sensitivity_V : (N, M p) derivatives of the voltage to the parameters
    """

    voltage_V: FloatArray
    soc: FloatArray
    sensitivity_V: FloatArray


@dataclass(frozen=True)
class Touched:
    """The parameters that a current reaches, those from number `begin` on.

    Attributes
    ----------
    voltage_V : (N,) as in `Prediction`
    sensitivity_V : (N, S) to these parameters
    prior : (S, S) what is known of them beforehand, whatever the others are
    begin : number of the first of them
    """

    voltage_V: FloatArray
    sensitivity_V: FloatArray
    prior: FloatArray
    begin: int


class Evaluator:
    """Information and its gradient for currents of one length; keeps its arrays between calls.

    Parameters
    ----------
    experiment : Experiment
    n_samples : length of the current; current_A[k] flows from k dt to (k + 1) dt
    criterion : "A", "D" or "E"
    """

    def __init__(self, experiment: Experiment, n_samples: int, criterion: str = "D") -> None:
        if criterion not in CRITERIA:
            raise ModelError(f"criterion {criterion!r} is unknown; use one of {', '.join(CRITERIA)}")
        if n_samples < 1:
            raise ModelError(f"a current of {n_samples} samples tells nothing; at least 1 is needed")
        self.experiment = experiment
        self._criterion = CRITERIA[criterion]
        self._net = flat_network(experiment.network)
        self._free_run = experiment.sensitivity == "free_run"
        self._prior = experiment.prior_information()
        # The derivative of the criterion to the information on the parameters from number `_begin` on.
        self._by_information, self._begin = lambda: self._prior, 0
        # In normalised units, as the sensitivities.
        self._variance = (experiment.working_V / experiment.network.voltage_span_V) ** 2
        n, (n_models, n_params) = n_samples + experiment.lead, experiment.network.theta.shape
        n_signals = len(experiment.network.structure.signals)
        self._temperature_degC = np.full(n, experiment.temperature_degC)
        self._current_A, self._soc, self._y = np.zeros(n), np.empty(n), np.empty(n)
        self._signals, self._slopes = np.empty((n, n_signals)), np.ones((n, n_signals))
        hats = experiment.network.structure.kernel == "hat"
        active, self._first = 2 if hats else n_models, np.zeros(n, dtype=np.int64)
        self._validity, self._blended = np.empty((n, active)), np.empty((n, n_params))
        self._psi, self._weights = np.empty((n, active * n_params)), np.empty((n, active * n_params))
        known = MarginalPrior(experiment.prior, n_models * n_params, experiment.prior_std)
        self._marginal = known if hats else None
        self._of_touched = hats and criterion == "D"
        self._by_signal, self._gradient = np.empty((n, n_signals)), np.empty(n)

    def value(self, current_A: FloatArray) -> float:
        """Criterion of a current; larger is better."""
        if self._marginal is None or not self._of_touched:
            value, derivative = self._criterion(self.information(current_A))
            self._by_information, self._begin = (lambda: derivative), 0
            return value
        self._simulate(current_A)
        lowest, n_models, n_params = self._reach()
        self._begin = lowest * n_params
        added = np.zeros((n_models * n_params, n_models * n_params))
        add_products(added, self._psi, self._first - lowest, n_params, 1.0 / self._variance)
        value, factor = self._marginal.d_optimality(added, self._begin)
        # Most values are of steps that are not taken: their gradients are not asked for.
        self._by_information = lambda: inverse_of(factor)
        return value

    def value_and_gradient(self, current_A: FloatArray) -> tuple[float, FloatArray]:
        """Criterion, and its derivative to each sample of the current in 1/A."""
        return self.value(current_A), self.gradient()

    def gradient(self) -> FloatArray:
        """(N,) derivative of the criterion to the current whose value was asked for last, in 1/A."""
        by_product, n_params = (2.0 / self._variance) * self._by_information(), self._blended.shape[1]
        times_block(self._psi, self._first - self._begin // n_params, n_params, by_product, self._weights)
        return self._back(np.zeros(len(self._y)))

    def information(self, current_A: FloatArray) -> FloatArray:
        """(M p, M p) information after the experiment, prior included (eq. 2.12)."""
        self._simulate(current_A)
        total = self._prior.copy()
        add_products(total, self._psi, self._first, self._blended.shape[1], 1.0 / self._variance)
        return total

    def information_over_time(self, current_A: FloatArray, ends: np.ndarray) -> Iterator[FloatArray]:
        """Information after the first `ends` samples of a current, one matrix after the other in the same memory."""
        self._simulate(current_A)
        total, lead, before = self._prior.copy(), self.experiment.lead, 0
        for end in ends:
            part = slice(lead + before, lead + int(end))
            add_products(total, self._psi[part], self._first[part], self._blended.shape[1], 1.0 / self._variance)
            before = int(end)
            yield total

    def predict(self, current_A: FloatArray) -> Prediction:
        """Predict voltage, state of charge and the voltage's sensitivities."""
        self._simulate(current_A)
        lead, network = self.experiment.lead, self.experiment.network
        psi = spread_out(self._psi[lead:], self._first[lead:], *network.theta.shape)
        return Prediction(network.to_volts(self._y[lead:]), self._soc[lead:].copy(), network.voltage_span_V * psi)

    def level_V(self) -> FloatArray:
        """(N,) standard deviation of what the fit cannot explain, along the current that was asked for last."""
        lead, levels = self.experiment.lead, self.experiment.level_V
        weight, first = self._validity[lead:], self._first[lead:]
        if levels is None:
            return np.full(len(first), self.experiment.noise_V)
        return np.sqrt(sum(weight[:, k] * levels[first + k] ** 2 for k in range(weight.shape[1])))

    def touched(self, current_A: FloatArray) -> Touched:
        """Predict the voltage with its sensitivities to what a current reaches only: of hats a part, else all."""
        self._simulate(current_A)
        lead, network = self.experiment.lead, self.experiment.network
        lowest, n_models, n_params = self._reach()
        psi = spread_out(self._psi[lead:], self._first[lead:] - lowest, n_models, n_params)
        begin, prior = lowest * n_params, self._prior
        if self._marginal is not None:
            prior, _ = self._marginal.part(begin, begin + psi.shape[1])
        return Touched(network.to_volts(self._y[lead:]), network.voltage_span_V * psi, prior, begin)

    def _reach(self) -> tuple[int, int, int]:
        """First of the local models that count anywhere, how many there are up to the last, and p."""
        lowest, n_params = int(self._first.min()), self._blended.shape[1]
        return lowest, int(self._first.max()) - lowest + self._validity.shape[1], n_params

    def voltage_gradient(
        self,
        current_A: FloatArray,
        by_voltage: FloatArray,
        by_sensitivity: FloatArray | None = None,
        begin: int = 0,
    ) -> FloatArray:
        """Derivative to the current of a function of the predicted voltage and its sensitivities.

        Parameters
        ----------
        current_A : (N,)
        by_voltage : (N,) derivative of the function to each predicted voltage
        by_sensitivity : (N, S) and to each of its sensitivities in V, to the parameters from number `begin` on that the
            current reaches; None: it does not depend on them
        begin : see `by_sensitivity`
        """
        self._simulate(current_A)
        self._weights[:] = 0.0
        if by_sensitivity is not None:
            lead, shape = self.experiment.lead, (self._psi.shape[1], self._blended.shape[1])
            own = picked(by_sensitivity, self._first[lead:] - begin // shape[1], *shape)
            self._weights[lead:] = self.experiment.network.voltage_span_V * own
        by_output = np.zeros(len(self._y))
        by_output[self.experiment.lead :] = self.experiment.network.voltage_span_V * by_voltage
        return self._back(by_output)

    def _simulate(self, current_A: FloatArray) -> None:
        self._current_A[self.experiment.lead :] = current_A
        net = self._net
        signals = (self._signals, self._slopes, self._soc)
        signal_values(net, self._current_A, self.experiment.initial_soc, self._temperature_degC, *signals)
        written = (self._first, self._validity, self._blended, self._y, self._psi)
        sensitivities(net, self._signals, self._free_run, *written)

    def _back(self, by_output: FloatArray) -> FloatArray:
        signal_gradient(
            self._net,
            self._signals,
            self._free_run,
            self._first,
            self._validity,
            self._blended,
            self._y,
            self._psi,
            self._weights,
            by_output,
            self._by_signal,
        )
        path = (self._current_A, self._soc, self._signals, self._slopes)
        current_gradient(self._net, *path, self._by_signal, self._gradient)
        return self._gradient[self.experiment.lead :].copy()
