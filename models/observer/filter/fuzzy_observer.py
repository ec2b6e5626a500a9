"""The fuzzy observer: the local models' Kalman filters, blended by the validity functions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.network.compiled_network import FlatNetwork, flat_network
from models.network.local_model_network import LocalModelNetwork
from models.network.signals.loop_form import LOOP
from models.observer.filter import packing, places
from models.observer.filter.gains import output_rows, state_matrices
from models.observer.filter.packing import Layout, pack
from models.observer.filter.settings import ObserverSettings, default_settings, error_levels
from models.observer.filter.steady import designed_gains

# Hypotheses for an initial state of charge that is not known well: this many, evenly over 0..1.
_HYPOTHESES = 32
# Each is as wide as this share of the distance to the next.
_OVERLAP = 0.6
# Below this the open-circuit curve is as good as straight.
_NARROW_STD = 0.03
# Even a given state of charge can be plain wrong: this share of belief is spread evenly.
_DOUBT = 1e-2
# What is left of an uncertainty where a value counts as told by the data.
_TOLD = 0.5
# Current in multiples of 1C by which the effect of a sensor's offset is looked at.
_MORE_C = 0.01
# Distance from the trained temperatures in K at which the model's error is thought twice as large. Bands of 19 measured
# runs at other temperatures hold 59 % without it, 82 % with 10 K, 87 % with 7, and 92 % with 4, which takes longest to
# leave a wrong start behind.
_DOUBLING_K = 6.0


@dataclass(frozen=True, slots=True)
class ObserverState:
    """Memory of the observer after a sample: hypotheses with their weights, and the derived signals' memory."""

    memory: FloatArray
    layout: Layout

    @property
    def x(self) -> FloatArray:
        """(J, s) states of the hypotheses."""
        return self.layout.part(self.memory, 0)

    @property
    def covariance(self) -> FloatArray:
        """(J, s, s) their covariances."""
        return self.layout.part(self.memory, 1)

    @property
    def weight(self) -> FloatArray:
        """(J,) how likely each is; 0: not there."""
        return self.layout.part(self.memory, 2)

    @property
    def held(self) -> FloatArray:
        """Last current, direction, temperature, samples seen, charge counted and its mean, offset of the sensor."""
        return self.layout.part(self.memory, 5)


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
    model_error_sigma : the model's error as the filter sees it, in multiples of what was assumed
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
    model_error_sigma: float

    @property
    def row(self) -> FloatArray:
        """(columns,) the same as one row of a replay."""
        return np.array([getattr(self, name) for name in COLUMNS])


COLUMNS = tuple(ObserverOutput.__dataclass_fields__)
# Seen through Any: the type checker takes the compiled functions' arguments for what they are without compilation.
_step: Any = packing.step
_replay: Any = packing.replay


class FuzzyObserver:
    """Estimates the state of charge with a local model network.

    The state is [y(k) ... y(k-n+1), SoC(k), model error, sensor and capacity error] (see `gains` for how this settles
    the printed method's contradictions, `settings` for the errors). An initial state of charge that is not known well
    is several hypotheses at once (see `compiled`).

    Parameters
    ----------
    network : a model with SoC(k-1) among its inputs, or by hats along it
    settings : noise and errors the filter is designed for; by default those in the model's record
    more_slow_V : (M,) what makes the slow error larger near each local model, standard deviation; nothing by default

    Raises
    ------
    ModelError
        The network has no SoC input, kernels other than Gaussian or hats, or a signal that is not made sample by
        sample.
    """

    def __init__(
        self,
        network: LocalModelNetwork,
        settings: ObserverSettings | None = None,
        more_slow_V: FloatArray | None = None,
    ) -> None:
        if network.structure.kernel not in ("gaussian", "hat"):
            raise ModelError(
                f"the observer needs a network with Gaussian validity functions or hats; its kernel is "
                f"{network.structure.kernel!r}"
            )
        self.network = network
        self.settings = settings or default_settings(network)
        self.more_slow_V = np.zeros(network.n_models) if more_slow_V is None else more_slow_V
        self.dt_s = network.structure.dt_s
        self._n = max(network.structure.output_order, 1)
        depth = 1 + max(1, *(lag for _, lag in network.structure.taps()))
        net = flat_network(network)
        self._loop = bool((net.form == LOOP).any())
        size = self._n + places.N_EXTRA + self._loop
        self._layout = Layout(_HYPOTHESES, size, len(network.structure.signals), depth)
        self._numbers, self._whole = self._pack(net)

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
        count, n, s = len(starts), self._n, self.settings
        state = ObserverState(np.zeros(self._layout.size), self._layout)
        state.x[:count, n], state.weight[:count] = starts, weights
        variances = (
            spread**2,
            1.0,
            1.0,
            (s.current_offset_std_C * self.network.cell.capacity_Ah) ** 2,
            s.capacity_std**2,
            (s.voltage_offset_std_V / self.network.voltage_span_V) ** 2,
            1.0,
            s.loop_std**2,
        )
        for place, variance in enumerate(variances[: places.N_EXTRA + self._loop]):
            state.covariance[:count, n + place, n + place] = variance
        state.held[places.HELD_OFFSET_STD] = s.current_offset_std_C * self.network.cell.capacity_Ah
        state.held[places.HELD_DIRECTION], state.held[places.HELD_TEMPERATURE] = -1.0, temperature_degC
        return state

    def step(
        self, state: ObserverState, current_A: float, voltage_V: float, temperature_degC: float
    ) -> tuple[ObserverState, ObserverOutput]:
        """One sample: state and measurement in, state and estimate out. NaN marks a missing value.

        Returns
        -------
        The new state (the old one is left as it was) and the estimate.
        """
        memory, row = state.memory.copy(), np.empty(places.N_OUT)
        _step(self._numbers, self._whole, memory, float(current_A), float(voltage_V), float(temperature_degC), row)
        return ObserverState(memory, state.layout), ObserverOutput(*row.tolist())

    def replay(
        self, state: ObserverState, current_A: FloatArray, voltage_V: FloatArray, temperature_degC: FloatArray
    ) -> tuple[ObserverState, FloatArray]:
        """Run over whole arrays with the same compiled step.

        Returns
        -------
        The last state and (N, columns), columns as in `ObserverOutput`.
        """
        memory, out = state.memory.copy(), np.empty((len(current_A), places.N_OUT))
        arrays = (np.ascontiguousarray(values, np.float64) for values in (current_A, voltage_V, temperature_degC))
        _replay(self._numbers, self._whole, memory, *arrays, out)
        return ObserverState(memory, state.layout), out

    def told_sensors(self, row: FloatArray) -> dict[str, dict[str, float] | None]:
        """Offset of the current sensor and capacity with their standard deviation; None where nothing was learned.

        A value counts as told where its uncertainty has come down to half of what was assumed at the start.
        """
        capacity_Ah, s = self.network.cell.capacity_Ah, self.settings
        assumed = (s.current_offset_std_C * capacity_Ah, s.capacity_std * capacity_Ah)
        columns = ((places.OFFSET_OUT, "current_offset_A"), (places.CAPACITY_OUT, "capacity_Ah"))
        found: dict[str, dict[str, float] | None] = {}
        for (place, name), prior in zip(columns, assumed, strict=True):
            std = float(row[place + 1])
            told = 0.0 < std <= _TOLD * prior
            found[name] = {"value": float(row[place]), "std": std} if told else None
        return found

    def _pack(self, net: FlatNetwork) -> tuple[FloatArray, np.ndarray]:
        network, s = self.network, self.settings
        state_matrices(network)  # refuses a network without SoC
        capacity_Ah, per_volt = network.cell.capacity_Ah, 1.0 / network.voltage_span_V
        rows = output_rows(network, s, error_levels(network), self.more_slow_V)
        low_degC, high_degC = network.record.domain.get("temperature_degC", (-np.inf, np.inf))
        constants = np.zeros(places.N_CONSTANTS)
        for place, value in (
            (places.Q_OUTPUT, (s.output_std_V * per_volt) ** 2),
            (places.Q_SOC, s.soc_std_per_sqrt_s**2 * self.dt_s),
            (places.R_VOLTAGE, (s.voltage_std_V * per_volt) ** 2),
            (places.QUICK_KEEP, np.exp(-self.dt_s / s.quick_error_time_s)),
            (places.SLOW_RATE, self.dt_s / s.slow_error_time_s),
            (places.SLOW_CHARGE, 1.0 / s.slow_error_soc),
            (places.STEADY, float(s.gain == "steady")),
            (places.NET_SHARE, min(self.dt_s / places.NET_S, 1.0)),
            (places.MORE_A, _MORE_C * capacity_Ah if s.current_offset_std_C > 0.0 else 0.0),
            (places.CAPACITY_AH, capacity_Ah),
            (places.BAND, s.band_factor),
            (places.R_JUDGED_MORE, ((s.judged_noise_V or s.voltage_std_V) ** 2 - s.voltage_std_V**2) * per_volt**2),
            (places.RESISTANCE_STD, s.resistance_std),
            (places.SERIES_STD, s.series_resistance_std_Ohm * per_volt),
            (places.TRAINED_LOW, low_degC),
            (places.TRAINED_HIGH, high_degC),
            (places.DOUBLING_K, _DOUBLING_K),
        ):
            constants[place] = value
        gains = np.zeros((network.n_models, self._layout.states + 1))
        if s.gain == "steady":
            steady = designed_gains(network, s, self.more_slow_V)
            gains[:, : self._n + 3], gains[:, -1] = steady[:, :-1], steady[:, -1]
        errors = np.ascontiguousarray(rows[:, self._n + 1 :].T)
        return pack(net, errors, gains, constants, self._layout)


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
