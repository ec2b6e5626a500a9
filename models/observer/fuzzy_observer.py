"""The fuzzy observer: the local models' Kalman filters, blended by the validity functions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from models.electrothermal import flat_network
from models.errors import ModelError
from models.local_model_network import LocalModelNetwork
from models.observer import compiled
from models.observer.gains import observer_matrices, output_rows, state_matrices, steady_state_gains
from models.observer.settings import ObserverSettings, default_settings, error_levels
from models.timeseries import FloatArray

# Hypotheses for an initial state of charge that is not known well: this many, evenly over 0..1.
_HYPOTHESES = 32
# Each is as wide as this share of the distance to the next.
_OVERLAP = 0.6
# Below this the open-circuit curve is as good as straight.
_NARROW_STD = 0.03
# Even a given state of charge can be plain wrong: this share of belief is spread evenly.
_DOUBT = 1e-2
# Current in multiples of 1C by which the effect of a sensor's offset is looked at.
_MORE_C = 0.01


@dataclass(frozen=True, slots=True)
class ObserverState:
    """Memory of the observer after a sample: hypotheses with their weights, and the derived signals' memory."""

    x: FloatArray
    covariance: FloatArray
    weight: FloatArray
    filters: FloatArray
    history: FloatArray
    held: FloatArray

    def copy(self) -> ObserverState:
        """Return an independent copy."""
        return ObserverState(
            self.x.copy(),
            self.covariance.copy(),
            self.weight.copy(),
            self.filters.copy(),
            self.history.copy(),
            self.held.copy(),
        )


@dataclass(frozen=True, slots=True)
class ObserverOutput:
    """What the observer says after a sample; the innovation is NaN where no voltage was measured.

    Attributes
    ----------
    soc, soc_std : fraction
    model_voltage_V : expected before the measurement
    innovation_V, innovation_std_V : measured minus expected, and how large that should be
    current_offset_A, current_offset_std_A : what the current sensor reads too much
    capacity_Ah, capacity_std_Ah : estimated capacity
    hypotheses : how many different states of charge are still held possible
    """

    soc: float
    soc_std: float
    model_voltage_V: float
    innovation_V: float
    innovation_std_V: float
    current_offset_A: float
    current_offset_std_A: float
    capacity_Ah: float
    capacity_std_Ah: float
    hypotheses: float


COLUMNS = tuple(ObserverOutput.__dataclass_fields__)
# Seen through Any: the type checker takes the compiled functions' tuples of arguments for single ones.
_step: Any = compiled.step
_replay: Any = compiled.replay


class FuzzyObserver:
    """Estimates the state of charge with a local model network.

    The state is [y(k) ... y(k-n+1), SoC(k), model error, sensor and capacity error] (see `gains` for how this settles
    the printed method's contradictions, `settings` for the errors). An initial state of charge that is not known well
    is several hypotheses at once (see `compiled`).

    Parameters
    ----------
    network : a model with SoC(k-1) among its inputs
    settings : noise and errors the filter is designed for; by default those in the model's record

    Raises
    ------
    ModelError
        The network has no SoC input or kernels other than Gaussian.
    """

    def __init__(self, network: LocalModelNetwork, settings: ObserverSettings | None = None) -> None:
        if network.structure.kernel != "gaussian":
            raise ModelError("the observer needs a network with Gaussian validity functions")
        self.network = network
        self.settings = settings or default_settings(network)
        self.dt_s = network.structure.dt_s
        self._volts_low, self._volts_span = network.scaling["voltage"][0], network.voltage_span_V
        self._n = max(network.structure.output_order, 1)
        self._size = self._n + compiled.N_EXTRA
        self._arguments = self._compile_arguments()
        rows = 7 + self._size
        self._scratch_shape = (rows, max(network.n_models, _HYPOTHESES, self._size + 1))

    def initial(self, soc: float, soc_std: float | None = None, temperature_degC: float = 25.0) -> ObserverState:
        """State before the first sample.

        Parameters
        ----------
        soc : fraction 0..1
        soc_std : its standard deviation; the settings' where None
        temperature_degC : used until a temperature is measured
        """
        std = self.settings.initial_soc_std if soc_std is None else soc_std
        starts, weights, spread = _hypotheses(soc, std)
        x = np.zeros((_HYPOTHESES, self._size))
        covariance = np.zeros((_HYPOTHESES, self._size, self._size))
        weight = np.zeros(_HYPOTHESES)
        count, n, s = len(starts), self._n, self.settings
        x[:count, n], weight[:count] = starts, weights
        one_C = self.network.cell.capacity_Ah
        variances = (spread**2, 1.0, 1.0, (s.current_offset_std_C * one_C) ** 2, s.capacity_std**2)
        variances = (*variances, (s.voltage_offset_std_V / self._volts_span) ** 2)
        for place, variance in zip(range(n, self._size), variances, strict=True):
            covariance[:count, place, place] = variance
        structure = self.network.structure
        depth = 1 + max(1, *(lag for _, lag in structure.taps()))
        n_signals = len(structure.signals)
        held = np.zeros(compiled.N_HELD)
        held[compiled.HELD_DIRECTION], held[compiled.HELD_TEMPERATURE] = -1.0, temperature_degC
        return ObserverState(
            x, covariance, weight, np.zeros((2, n_signals, 3)), np.zeros((2, depth, n_signals)), held
        )

    def step(
        self, state: ObserverState, current_A: float, voltage_V: float, temperature_degC: float
    ) -> tuple[ObserverState, ObserverOutput]:
        """One sample: state and measurement in, state and estimate out. NaN marks a missing value.

        Returns
        -------
        The new state (the old one is left as it was) and the estimate.
        """
        new = state.copy()
        row = np.empty(compiled.N_OUT)
        _step(
            *self._arguments,
            *_memory(new),
            np.empty(self._scratch_shape),
            float(current_A),
            (float(voltage_V) - self._volts_low) / self._volts_span,
            float(temperature_degC),
            row,
        )
        return new, ObserverOutput(*self._to_physical(row[None])[0].tolist())

    def replay(
        self, state: ObserverState, current_A: FloatArray, voltage_V: FloatArray, temperature_degC: FloatArray
    ) -> tuple[ObserverState, FloatArray]:
        """Run over whole arrays with the same compiled step.

        Returns
        -------
        The last state and (N, columns), columns as in `ObserverOutput`.
        """
        new = state.copy()
        out = np.empty((len(current_A), compiled.N_OUT))
        _replay(
            *self._arguments,
            *_memory(new),
            np.empty(self._scratch_shape),
            np.ascontiguousarray(current_A, dtype=np.float64),
            (np.ascontiguousarray(voltage_V, dtype=np.float64) - self._volts_low) / self._volts_span,
            np.ascontiguousarray(temperature_degC, dtype=np.float64),
            out,
        )
        return new, self._to_physical(out)

    def _to_physical(self, rows: FloatArray) -> FloatArray:
        out = rows.copy()
        for column in (
            compiled.SOC_VAR_OUT,
            compiled.INNOVATION_VAR_OUT,
            compiled.OFFSET_VAR_OUT,
            compiled.CAPACITY_VAR_OUT,
        ):
            out[:, column] = np.sqrt(np.maximum(rows[:, column], 0.0))
        out[:, compiled.SOC_VAR_OUT] *= self.settings.band_factor
        span, capacity_Ah = self._volts_span, self.network.cell.capacity_Ah
        out[:, compiled.VOLTAGE_OUT] = self._volts_low + span * rows[:, compiled.VOLTAGE_OUT]
        out[:, compiled.INNOVATION_OUT] *= span
        out[:, compiled.INNOVATION_VAR_OUT] *= span
        # SoC moves by (1 + e) times what the nominal capacity says.
        out[:, compiled.CAPACITY_OUT] = capacity_Ah / (1.0 + rows[:, compiled.CAPACITY_OUT])
        out[:, compiled.CAPACITY_VAR_OUT] *= capacity_Ah
        return out

    def _compile_arguments(self) -> tuple[Any, ...]:
        network, s = self.network, self.settings
        state_matrices(network)  # refuses a network without SoC
        level = error_levels(network)
        per_volt = 1.0 / self._volts_span
        constants = np.zeros(compiled.N_CONSTANTS)
        constants[compiled.Q_OUTPUT] = (s.output_std_V * per_volt) ** 2
        constants[compiled.Q_SOC] = s.soc_std_per_sqrt_s**2 * self.dt_s
        constants[compiled.R_VOLTAGE] = (s.voltage_std_V * per_volt) ** 2
        constants[compiled.QUICK_KEEP] = np.exp(-self.dt_s / s.quick_error_time_s)
        constants[compiled.SLOW_RATE] = self.dt_s / s.slow_error_time_s
        constants[compiled.SLOW_CHARGE] = 1.0 / s.slow_error_soc
        constants[compiled.QUICK_STD] = s.quick_error_std_V * per_volt
        constants[compiled.SLOW_STD] = s.slow_error_std_V * per_volt
        constants[compiled.NET_SHARE] = min(self.dt_s / compiled.NET_S, 1.0)
        constants[compiled.MORE_A] = _MORE_C * network.cell.capacity_Ah if s.current_offset_std_C > 0.0 else 0.0
        gains = np.zeros((network.n_models, self._size + 1))
        if s.gain == "steady":
            constants[compiled.STEADY] = 1.0
            matrices, process = observer_matrices(network, s)
            steady = steady_state_gains(
                matrices, output_rows(network, s, level), process, constants[compiled.R_VOLTAGE]
            )
            gains[:, : self._n + 3], gains[:, -1] = steady[:, :-1], steady[:, -1]
        return flat_network(network), level, gains, constants


def _memory(state: ObserverState) -> tuple[FloatArray, ...]:
    return state.x, state.covariance, state.weight, state.filters, state.history, state.held


def _hypotheses(soc: float, std: float) -> tuple[FloatArray, FloatArray, float]:
    """Means, weights and common standard deviation of the hypotheses that stand for an initial state of charge."""
    if std <= _NARROW_STD:
        return np.array([soc]), np.ones(1), std
    distance = 1.0 / _HYPOTHESES
    starts = (np.arange(_HYPOTHESES) + 0.5) * distance
    width = max(std, distance)
    weights = np.exp(-0.5 * ((starts - soc) / width) ** 2)
    weights = (1.0 - _DOUBT) * weights / weights.sum() + _DOUBT / _HYPOTHESES
    return starts, weights, _OVERLAP * distance
