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

from dataclasses import asdict, replace
from typing import Any

import numpy as np

from models.data.timeseries import FloatArray
from models.network.compiled_network import flat_network
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import VOLTAGE
from models.recursive import update_step
from models.recursive.prior import update_rule
from models.recursive.settings import UpdateSettings
from models.recursive.state import UpdateOutput, UpdateState
from models.recursive.update_step import N_HELD, N_OUT

# Seen through Any: the type checker takes the compiled functions' tuples of arguments for single ones.
_step: Any = update_step.step
_replay: Any = update_step.replay


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
        self._rule = update_rule(network, self.settings)
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
        update = {"settings": asdict(self.settings), "n_samples": state.n_samples}
        record = replace(self.network.record, update=update)
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
