"""What the observer assumes of noise, of the model's error and of the sensors."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from models.data.errors import ModelError
from models.network.local_model_network import LocalModelNetwork
from models.uncertainty.model_uncertainty import uncertainty_of

GAINS = ("kalman", "steady")
# A part of the model's error that fades faster than this is the quick one.
_QUICK_S = 100.0
# And one that fades within about two samples is told from noise by nothing.
_WHITE_S = 3.0
_MAY_BE_ZERO = (
    "output_std_V",
    "quick_error_std_V",
    "slow_error_std_V",
    "current_offset_std_C",
    "capacity_std",
    "voltage_offset_std_V",
    "resistance_std",
    "series_resistance_std_Ohm",
    "loop_std",
    "judged_noise_V",
)


@dataclass(frozen=True)
class ObserverSettings:
    """Noise, model error and sensor errors that the filter is designed for.

    The model's error is no white noise: a wrong open-circuit curve is wrong for as long as the cell stays at its state
    of charge. Two Gauss-Markov states carry it, without which the filter would take thousand samples of one error for
    thousand measurements, and its band would be far too narrow.

    Attributes
    ----------
    voltage_std_V : white noise of the measured voltage
    quick_error_std_V, quick_error_time_s : model error that fades within seconds to minutes (dynamics)
    slow_error_std_V, slow_error_time_s, slow_error_soc : model error that fades with time and with the charge that
        moves (open-circuit curve, slow diffusion); it is down to 1/e after `slow_error_soc` of the capacity
    resistance_std : relative standard deviation of what the current does to the output; changes as the slow error does
    series_resistance_std_Ohm : standard deviation of a resistance in series with the cell that is not in the model
        (contacts, connectors of a module); it adds to the error of the resistances as if both were one
    loop_std : standard deviation of the place in the hysteresis loop at the start, which nobody measures; the loop
        reaches from -1 to 1, and 0 takes a start in its middle for known
    output_std_V : process noise of the model's output per sample; 0 where the model was fitted in free run, as here
    soc_std_per_sqrt_s : process noise of the SoC as a random walk, fraction per sqrt(s)
    initial_soc_std : uncertainty of the initial SoC where none is given
    current_offset_std_C : standard deviation of the current sensor's offset, in multiples of 1C; 0 leaves it out
    capacity_std : relative standard deviation of the capacity; 0 leaves it out
    voltage_offset_std_V : standard deviation of the voltage sensor's offset against the rig that the model was
        identified on (an offset that was there already is in the model); 0 leaves it out
    band_factor : by how much the standard deviation of the SoC is widened, calibrated on data
    judged_noise_V : white noise by which innovations are judged where `voltage_std_V` is more for the sake of the SoC,
        with which health would be blind; 0 is `voltage_std_V`
    gain : "kalman", from the covariance of the moment, or "steady", the local models' steady-state gains blended by
        the validity functions (eq. 2.42), once the start is over
    """

    voltage_std_V: float = 0.003
    quick_error_std_V: float = 0.005
    quick_error_time_s: float = 30.0
    slow_error_std_V: float = 0.008
    slow_error_time_s: float = 3600.0
    slow_error_soc: float = 0.1
    resistance_std: float = 0.02
    series_resistance_std_Ohm: float = 0.0
    loop_std: float = 0.58
    output_std_V: float = 0.0
    soc_std_per_sqrt_s: float = 1e-5
    initial_soc_std: float = 0.2
    current_offset_std_C: float = 0.005
    capacity_std: float = 0.005
    voltage_offset_std_V: float = 0.0
    band_factor: float = 1.0
    judged_noise_V: float = 0.0
    gain: str = "kalman"

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types."""
        return asdict(self)

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> ObserverSettings:
        """Read what `to_json` wrote; a value that is not a positive finite number is a ModelError."""
        try:
            values: dict[str, Any] = {k: v if k == "gain" else float(v) for k, v in document.items()}
            settings = cls(**values)
        except (TypeError, ValueError, AttributeError) as error:
            raise ModelError(f"observer settings: {error}") from None
        if settings.gain not in GAINS:
            raise ModelError(f"observer settings: gain is {settings.gain!r}; use one of {', '.join(GAINS)}")
        for field in fields(cls):
            value = getattr(settings, field.name)
            if field.name == "gain" or (value == 0.0 and field.name in _MAY_BE_ZERO):
                continue
            if not (np.isfinite(value) and value > 0.0):
                raise ModelError(f"observer settings: {field.name} is {value:g}; it must be positive")
        return settings


def default_settings(network: LocalModelNetwork) -> ObserverSettings:
    """Settings for a model: those that were tuned with it, else what it knows of its own held-out error.

    Raises
    ------
    ModelError
        The stored settings are damaged.
    """
    stored = network.record.observer
    if stored:
        return ObserverSettings.from_json(stored)
    uncertainty = uncertainty_of(network)
    if uncertainty is None:
        rmse_V = 1e-3 * max(network.record.train_rmse_mV(10.0), 1.0)
        return ObserverSettings(voltage_std_V=rmse_V, quick_error_std_V=0.5 * rmse_V, slow_error_std_V=rmse_V)
    rms_V = float(np.sqrt(np.average(uncertainty.level_V**2, weights=np.maximum(uncertainty.samples, 1.0))))
    correlation = uncertainty.correlation
    time_s = -network.dt_s / np.log(np.clip(correlation.keep, 1e-6, 1.0 - 1e-9))
    noise, quick = time_s < _WHITE_S, time_s < _QUICK_S
    slow = time_s >= _QUICK_S
    quick &= ~noise
    least_V = 0.1 * rms_V
    white = max(correlation.white, 0.0) + correlation.shares[noise].sum()
    floor_V = 1e-3 * float(network.record.noise_floor_mV or 0.0)
    return ObserverSettings(
        voltage_std_V=max(rms_V * float(np.sqrt(white)), min(floor_V, rms_V), least_V),
        quick_error_std_V=max(rms_V * float(np.sqrt(correlation.shares[quick].sum())), least_V),
        quick_error_time_s=_mean_time_s(time_s[quick], correlation.shares[quick], 20.0),
        slow_error_std_V=max(rms_V * float(np.sqrt(correlation.shares[slow].sum())), least_V),
        slow_error_time_s=max(_mean_time_s(time_s[slow], correlation.shares[slow], 3600.0), 3600.0),
    )


def error_levels(network: LocalModelNetwork) -> np.ndarray:
    """(M,) how large the model's error is near each local model, relative to all; 1 where nothing is known of it."""
    uncertainty = uncertainty_of(network)
    if uncertainty is None:
        return np.ones(network.n_models)
    level = np.asarray(uncertainty.level_V, dtype=np.float64)
    rms = np.sqrt(np.average(level**2, weights=np.maximum(uncertainty.samples, 1.0)))
    return np.ascontiguousarray(level / rms)


def _mean_time_s(time_s: np.ndarray, shares: np.ndarray, otherwise: float) -> float:
    """Fading time of several parts together: their share-weighted geometric mean."""
    if len(time_s) == 0 or shares.sum() <= 0.0:
        return otherwise
    return float(np.exp(np.average(np.log(time_s), weights=shares)))
