"""Recursive update of a live network: the local models follow a cell that ages, sample by sample.

Recursive least squares on the free-run error, one recursion for each local model, weighted by its validity. For
networks without past outputs this is the recursive least squares of the local models; with past outputs the regressors
are the free run's own outputs and the gradient passes through the recursion (recursive prediction error method),
because measured past outputs with their noise would pull the poles towards zero.

A parameter forgets towards what it may be at all, not by a common factor: its covariance returns to the prior's in the
course of `memory_s` of samples in the middle of its local model, and never exceeds it. A direction that the data do not
excite therefore stays where it is, however long that lasts.

Ljung, "System Identification", 2nd ed. 1999, ch. 11.2 and 11.4 (recursive prediction error methods); Kulhavy and
Zarrop, "On a general concept of forgetting", Int. J. Control 58, 1993 (stabilised forgetting).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.network.compiled_network import flat_network
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import VOLTAGE, normalise
from models.network.signals import is_soc, parse_signal
from models.recursive import update_step
from models.recursive.update_step import N_HELD, N_OUT, FlatUpdate

# Seen through Any: the type checker takes the compiled functions' tuples of arguments for single ones.
_step: Any = update_step.step
_replay: Any = update_step.replay
# Standard deviations that a parameter may move away from where it began.
_REACH = 10.0
# A tap is taken to be at least this share of all taps of the current.
_LEAST_SHARE = 0.1


@dataclass(frozen=True)
class UpdateSettings:
    """How fast, and how far, the parameters may move.

    Attributes
    ----------
    memory_s : time in the middle of a local model after which a parameter is as open as at the beginning
    resistance_std : of each resistance-like parameter, relative
    ocv_std_V : of the open-circuit voltage at the middle of each local model
    slope_std : of the open-circuit voltage's slope, relative
    pole_std : of a local model's distance to the integrator (1 - sum of output coefficients), relative
    error_memory_s : how long the model's error stays alike; samples within it tell the same
    voltage_std_V : noise with the model's own error; by default the model's error on its training runs, at least 1 mV
    """

    memory_s: float = 24 * 3600.0
    resistance_std: float = 0.3
    ocv_std_V: float = 0.005
    slope_std: float = 0.05
    pole_std: float = 0.05
    error_memory_s: float = 30.0
    voltage_std_V: float | None = None

    def __post_init__(self) -> None:
        """Check ranges."""
        for key, value in asdict(self).items():
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise ModelError(f"update settings: {key} is {value:g}; it must be positive and finite")


@dataclass(frozen=True, slots=True)
class UpdateState:
    """Everything that the next sample needs.

    Attributes
    ----------
    theta : (M, p) parameters in normalised units
    covariance : (M, p, p) of each local model's parameters
    filters, history : memory of the signals
    past, sensitivity : simulated outputs, newest first, and their derivatives
    held : last current, direction, SoC, temperature, samples seen
    """

    theta: FloatArray
    covariance: FloatArray
    filters: FloatArray
    history: FloatArray
    past: FloatArray
    sensitivity: FloatArray
    held: FloatArray

    def copy(self) -> UpdateState:
        """Return an independent copy."""
        return UpdateState(
            self.theta.copy(),
            self.covariance.copy(),
            self.filters.copy(),
            self.history.copy(),
            self.past.copy(),
            self.sensitivity.copy(),
            self.held.copy(),
        )

    @property
    def soc(self) -> float:
        """Counted or given state of charge after the last sample."""
        return float(self.held[update_step.SOC])

    @property
    def n_samples(self) -> int:
        """Samples that the state has seen."""
        return int(self.held[update_step.SEEN])


@dataclass(frozen=True, slots=True)
class UpdateOutput:
    """What a sample said: the free run before the update, its error (NaN where nothing was measured), its std."""

    model_voltage_V: float
    error_V: float
    error_std_V: float


class RecursiveUpdate:
    """Follows a cell with a network.

    Parameters
    ----------
    network : the model to begin with
    settings : how fast and how far it may move
    """

    def __init__(self, network: LocalModelNetwork, settings: UpdateSettings | None = None) -> None:
        self.network = network
        self.settings = settings or UpdateSettings()
        self._net = flat_network(network)
        self._rule = _rule(network, self.settings)
        self._low, self._span = network.scaling[VOLTAGE][0], network.voltage_span_V

    def initial(self, soc: float, temperature_degC: float = 25.0) -> UpdateState:
        """State before the first sample.

        Parameters
        ----------
        soc : fraction 0..1
        temperature_degC : used until a temperature is measured
        """
        net, (n_models, p) = self._net, self.network.theta.shape
        order, n_signals = max(net.order, 1), len(net.form)
        depth = 1 + int(max(net.tap_lag.max(), net.axis_lag.max()))
        held = np.zeros(N_HELD)
        held[update_step.DIRECTION], held[update_step.SOC], held[update_step.TEMPERATURE] = -1.0, soc, temperature_degC
        return UpdateState(
            theta=np.array(self.network.theta, dtype=np.float64),
            covariance=self._rule.prior.copy(),
            filters=np.zeros((n_signals, 3)),
            history=np.zeros((depth, n_signals)),
            past=np.zeros(order),
            sensitivity=np.zeros((order, n_models, p)),
            held=held,
        )

    def resumed(self, state: UpdateState, soc: float) -> UpdateState:
        """State for the first sample of another run: what was learned stays, the cell's memory begins anew."""
        fresh = self.initial(soc, float(state.held[update_step.TEMPERATURE]))
        return replace(fresh, theta=state.theta.copy(), covariance=state.covariance.copy())

    def step(
        self,
        state: UpdateState,
        current_A: float,
        voltage_V: float,
        temperature_degC: float,
        soc: float = float("nan"),
    ) -> tuple[UpdateState, UpdateOutput]:
        """One sample: state and measurement in, state and what it said out. NaN marks a missing value.

        Parameters
        ----------
        state : left as it was
        current_A, voltage_V, temperature_degC : the sample
        soc : fraction from an observer; counted from the current where it is missing
        """
        new, row = state.copy(), np.empty(N_OUT)
        _step(
            self._net,
            self._rule,
            *_memory(new),
            float(current_A),
            (float(voltage_V) - self._low) / self._span,
            float(temperature_degC),
            float(soc),
            row,
        )
        y, error, variance = (float(value) for value in row)
        std_V = self._span * float(np.sqrt(variance))
        return new, UpdateOutput(self._low + self._span * y, self._span * error, std_V)

    def replay(
        self,
        state: UpdateState,
        current_A: FloatArray,
        voltage_V: FloatArray,
        temperature_degC: FloatArray,
        soc: FloatArray | None = None,
    ) -> tuple[UpdateState, FloatArray]:
        """Run over whole arrays with the same compiled step.

        Returns
        -------
        The last state and (N, 3): free run in V, its error in V, the error's standard deviation in V.
        """
        new, out = state.copy(), np.empty((len(current_A), N_OUT))
        known = np.full(len(current_A), np.nan) if soc is None else soc
        _replay(
            self._net,
            self._rule,
            *_memory(new),
            np.ascontiguousarray(current_A, dtype=np.float64),
            (np.ascontiguousarray(voltage_V, dtype=np.float64) - self._low) / self._span,
            np.ascontiguousarray(temperature_degC, dtype=np.float64),
            np.ascontiguousarray(known, dtype=np.float64),
            out,
        )
        out[:, 0] = self._low + self._span * out[:, 0]
        out[:, 1] *= self._span
        out[:, 2] = self._span * np.sqrt(out[:, 2])
        return new, out

    def updated(self, state: UpdateState) -> LocalModelNetwork:
        """Return the network with the parameters that a state holds, and a record of how it came by them."""
        record = self.network.record | {
            "update": {"settings": asdict(self.settings), "n_samples": state.n_samples},
        }
        return replace(self.network, theta=state.theta.copy(), record=record)


def _memory(state: UpdateState) -> tuple[FloatArray, ...]:
    return (
        state.theta,
        state.covariance,
        state.filters,
        state.history,
        state.past,
        state.sensitivity,
        state.held,
    )


def _rule(network: LocalModelNetwork, settings: UpdateSettings) -> FlatUpdate:
    at = _middle(network)
    n_models, p = network.theta.shape
    prior = np.zeros((n_models, p, p))
    for i in range(n_models):
        directions = _directions(network, settings, i)
        # Whatever a parameter does, the settled voltage in the middle of the local model at rest stays: the offset
        # takes it back. What is left to the offset itself is the open-circuit voltage's own spread.
        directions[-1, :-1] -= at[i, :-1] @ directions[:-1, :-1]
        prior[i] = directions @ directions.T
    reach = _REACH * np.sqrt(np.einsum("ipp->ip", prior))
    forgetting = 1.0 - float(np.exp(-network.structure.dt_s / settings.memory_s))
    theta = network.theta
    noise = (_noise_V(network, settings) / network.voltage_span_V) ** 2
    return FlatUpdate(prior, theta - reach, theta + reach, noise, forgetting)


def _noise_V(network: LocalModelNetwork, settings: UpdateSettings) -> float:
    """Standard deviation of what one sample says, where errors of neighbouring samples are alike."""
    rmse_mV = float((network.record.get("train") or {}).get("rmse_mV", 10.0))
    voltage_V = settings.voltage_std_V or 1e-3 * max(rmse_mV, 1.0)
    return voltage_V * float(np.sqrt(1.0 + 2.0 * settings.error_memory_s / network.structure.dt_s))


def _distance(network: LocalModelNetwork) -> FloatArray:
    """(M,) how far each local model is from an integrator: 1 - sum of its output coefficients."""
    return np.maximum(1.0 - network.theta[:, : network.structure.output_order].sum(axis=1), 1e-3)


def _middle(network: LocalModelNetwork) -> FloatArray:
    """(M, p) regressors in the middle of each local model, at rest and settled."""
    structure, theta = network.structure, network.theta
    order = structure.output_order
    at = np.ones_like(theta)
    for column, (signal, _) in enumerate(structure.taps(), start=order):
        if parse_signal(signal).definition.as_resistance:
            at[:, column] = normalise(np.zeros(1), network.scaling[signal])[0]
        elif is_soc(signal) and structure.soc_axis >= 0:
            at[:, column] = network.partition.centres[:, structure.soc_axis]
        else:
            at[:, column] = 0.5
    settled = np.einsum("ip,ip->i", theta[:, order:], at[:, order:]) / _distance(network)
    at[:, :order] = settled[:, None]
    return at


def _directions(network: LocalModelNetwork, settings: UpdateSettings, i: int) -> FloatArray:
    """(p, p) columns: independent changes of local model i, each of one standard deviation.

    With past outputs a change of one tap of the current acts through the recursion: a cell whose ohmic resistance grows
    moves several taps at once, tap j by R and tap j + l by -a_l R. Where there are taps enough, that is the direction.
    """
    structure, theta = network.structure, network.theta[i]
    order, taps = structure.output_order, structure.taps()
    distance = float(_distance(network)[i])
    current = [order + t for t, (signal, _) in enumerate(taps) if parse_signal(signal).definition.as_resistance]
    settled = float(np.abs(theta[current]).sum()) if order == 0 else abs(float(theta[current].sum()))
    out = np.zeros((len(theta), len(theta)))
    out[:order, :order] = np.eye(order) * settings.pole_std * distance
    for column, (signal, _) in enumerate(taps, start=order):
        own = column + np.arange(order + 1)
        room = column + order < len(theta) - 1 and all(taps[c - order][0] == signal for c in own)
        if column not in current:
            out[column, column] = settings.slope_std * abs(theta[column])
        elif order > 0 and room:
            size = max(abs(theta[column]), _LEAST_SHARE * settled / distance)
            out[own, column] = settings.resistance_std * size * np.concatenate([[1.0], -theta[:order]])
        else:
            size = max(abs(theta[column]) if order == 0 else 0.0, _LEAST_SHARE * settled if order == 0 else settled)
            out[column, column] = settings.resistance_std * size
    out[-1, -1] = settings.ocv_std_V / network.voltage_span_V * distance
    return out
