"""The fuzzy observer: steady-state Kalman filters of all local models, blended by the validity functions."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from models.errors import ModelError
from models.local_model_network import LocalModelNetwork
from models.observer import compiled
from models.observer.gains import state_matrices, steady_state_gains
from models.regression import VOLTAGE, axis_lag
from models.signals import diffusion_rates, parse_signal, relaxation_poles
from models.timeseries import FloatArray


@dataclass(frozen=True)
class ObserverSettings:
    """Noise that the filters are designed for.

    Attributes
    ----------
    voltage_std_V : measurement noise with the model's own error, R
    output_std_V : process noise of the output per sample
    soc_std_per_sqrt_s : process noise of the SoC as a random walk, fraction per sqrt(s)
    initial_soc_std : uncertainty of the initial SoC where none is given
    """

    voltage_std_V: float = 0.01
    output_std_V: float = 0.003
    soc_std_per_sqrt_s: float = 5e-5
    initial_soc_std: float = 0.1

    def to_json(self) -> dict[str, float]:
        """Return a document of plain types."""
        return asdict(self)

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> ObserverSettings:
        """Read what `to_json` wrote; a value that is not a positive finite number is a ModelError."""
        try:
            settings = cls(**{key: float(value) for key, value in document.items()})
        except (TypeError, ValueError) as error:
            raise ModelError(f"observer settings: {error}") from None
        for key, value in asdict(settings).items():
            if not (np.isfinite(value) and value > 0.0):
                raise ModelError(f"observer settings: {key} is {value:g}; it must be positive")
        return settings


@dataclass(frozen=True, slots=True)
class ObserverState:
    """Memory of the observer after a sample: filter state, covariance and the derived signals' memory."""

    x: FloatArray
    covariance: FloatArray
    filters: FloatArray
    history: FloatArray
    held: FloatArray

    def copy(self) -> ObserverState:
        """Return an independent copy."""
        return ObserverState(
            self.x.copy(), self.covariance.copy(), self.filters.copy(), self.history.copy(), self.held.copy()
        )


@dataclass(frozen=True, slots=True)
class ObserverOutput:
    """What the observer says after a sample; the innovation is NaN where no voltage was measured."""

    soc: float
    soc_std: float
    model_voltage_V: float
    innovation_V: float
    innovation_std_V: float


# Seen through Any: the type checker takes the compiled functions' tuples of arguments for single ones.
_step: Any = compiled.step
_replay: Any = compiled.replay


class FuzzyObserver:
    """Estimates the state of charge with a local model network.

    The state is [y(k) ... y(k-n+1), SoC(k)] (see `gains` for how this settles the printed method's contradictions),
    the integrator is scaled with the network's normalisation (remark after eq. 2.38).

    Parameters
    ----------
    network : a model with SoC(k-1) among its inputs
    settings : noise the filters are designed for

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
        self._volts_low, volts_high = network.scaling[VOLTAGE]
        self._volts_span = volts_high - self._volts_low
        self._arguments = self._compile_arguments()

    def initial(self, soc: float, soc_std: float | None = None, temperature_degC: float = 25.0) -> ObserverState:
        """State before the first sample.

        Parameters
        ----------
        soc : fraction 0..1
        soc_std : its standard deviation; the settings' where None
        temperature_degC : used until a temperature is measured
        """
        structure = self.network.structure
        size = max(structure.output_order, 1) + 1
        x = np.zeros(size)
        x[-1] = soc
        covariance = np.zeros((size, size))
        std = self.settings.initial_soc_std if soc_std is None else soc_std
        covariance[-1, -1] = std**2
        lags = max([1, *(c.delay + c.order for c in structure.inputs)])
        n_signals = len(structure.signals)
        held = np.array([0.0, -1.0, temperature_degC, 0.0])
        return ObserverState(x, covariance, np.zeros((n_signals, 3)), np.zeros((lags, n_signals)), held)

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
            new.x,
            new.covariance,
            new.filters,
            new.history,
            new.held,
            float(current_A),
            (float(voltage_V) - self._volts_low) / self._volts_span,
            float(temperature_degC),
            row,
        )
        values = self._to_physical(row[None])[0]
        return new, ObserverOutput(*(float(v) for v in values))

    def replay(
        self, state: ObserverState, current_A: FloatArray, voltage_V: FloatArray, temperature_degC: FloatArray
    ) -> tuple[ObserverState, FloatArray]:
        """Run over whole arrays with the same compiled step.

        Returns
        -------
        The last state and (N, 5): SoC, its std, model voltage in V, innovation in V, innovation std in V.
        """
        new = state.copy()
        out = np.empty((len(current_A), compiled.N_OUT))
        _replay(
            *self._arguments,
            new.x,
            new.covariance,
            new.filters,
            new.history,
            new.held,
            np.ascontiguousarray(current_A, dtype=np.float64),
            (np.ascontiguousarray(voltage_V, dtype=np.float64) - self._volts_low) / self._volts_span,
            np.ascontiguousarray(temperature_degC, dtype=np.float64),
            out,
        )
        return new, self._to_physical(out)

    def _to_physical(self, rows: FloatArray) -> FloatArray:
        out = np.empty_like(rows)
        out[:, 0] = rows[:, 0]
        out[:, 1] = np.sqrt(np.maximum(rows[:, 1], 0.0))
        out[:, 2] = self._volts_low + self._volts_span * rows[:, 2]
        out[:, 3] = self._volts_span * rows[:, 3]
        out[:, 4] = self._volts_span * np.sqrt(np.maximum(rows[:, 4], 0.0))
        return out

    def _compile_arguments(self) -> tuple[Any, ...]:
        network, structure = self.network, self.network.structure
        names = structure.signals
        taps = [(names.index(signal), lag) for signal, lag in structure.taps()]
        axes = [(names.index(a.signal), axis_lag(a.signal)) for a in structure.axes]
        soc_per_ampere = self.dt_s / (3600.0 * network.cell.capacity_Ah)
        variances = self._variances()
        constants = np.array([soc_per_ampere, *variances, network.cell.rest_A])
        gains = steady_state_gains(state_matrices(network), *variances)
        return (
            np.ascontiguousarray(network.theta, dtype=np.float64),
            np.ascontiguousarray(network.partition.centres),
            np.ascontiguousarray(1.0 / network.partition.widths),
            gains,
            structure.output_order,
            np.array([compiled.CODES[parse_signal(name).kind] for name in names]),
            np.array([self._signal_constants(name) for name in names]),
            np.array([signal for signal, _ in taps]),
            np.array([lag for _, lag in taps]),
            np.array([signal for signal, _ in axes]),
            np.array([lag for _, lag in axes]),
            constants,
        )

    def _signal_constants(self, name: str) -> FloatArray:
        """One signal's row of constants for the compiled step."""
        signal, cell = parse_signal(name), self.network.cell
        row = np.zeros(compiled.N_CONSTANTS)
        row[compiled.GAIN] = 1.0
        time_constant_s = signal.get("time_constant_s")
        if signal.kind == "relaxation":
            row[compiled.POLE : compiled.POLE + 3] = relaxation_poles(time_constant_s, self.dt_s)
            row[compiled.GAIN] = 1.0 / (1.0 - row[compiled.POLE])
        elif signal.kind == "surface_soc":
            row[compiled.POLE : compiled.POLE + 3] = diffusion_rates(time_constant_s, self.dt_s)
        elif time_constant_s:
            row[compiled.POLE] = np.exp(-self.dt_s / time_constant_s)
        if signal.kind in ("soc", "surface_soc"):
            row[compiled.GAIN] = signal.get("depth") / cell.capacity_Ah
        row[compiled.ACTIVATION] = signal.get("activation_K")
        row[compiled.EXCHANGE] = signal.get("exchange_current_A")
        row[compiled.RATE] = signal.get("rate") * self.dt_s / (3600.0 * cell.capacity_Ah)
        low, high = self.network.scaling[name]
        row[compiled.LOW], row[compiled.SPAN] = low, high - low
        return row

    def _variances(self) -> tuple[float, float, float]:
        """Process noise of output and SoC per sample and measurement noise; the output's in normalised units."""
        s = self.settings
        return (
            (s.output_std_V / self._volts_span) ** 2,
            s.soc_std_per_sqrt_s**2 * self.dt_s,
            (s.voltage_std_V / self._volts_span) ** 2,
        )


def default_settings(network: LocalModelNetwork) -> ObserverSettings:
    """Settings from what the model knows of itself: its free-run error on the training data, at least 1 mV."""
    rmse_mV = float((network.record.get("train") or {}).get("rmse_mV", 10.0))
    voltage_std_V = max(rmse_mV, 1.0) * 1e-3
    return ObserverSettings(voltage_std_V=voltage_std_V, output_std_V=0.3 * voltage_std_V)
