"""The measuring layer: offsets, seeded noise and quantisation between the truth and the registers."""

import math
from dataclasses import dataclass, fields
from typing import NamedTuple, Protocol

import numpy as np

from simulators.cell import CellOutput

__all__ = ["Measurement", "MeasuringLayer", "SensorParameters", "Sensors"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorParameters:
    """Errors of the sensors: standard deviations, steps of the converter (0: none) and constant errors.

    Voltage and current are read too large by their gain, a share, and by their offset. The temperature sensor reads
    `temperature_gain` times the difference to ambient, plus its offset.
    """

    voltage_noise_V: float = 1e-3
    current_noise_A: float = 1e-3
    temperature_noise_K: float = 0.02
    voltage_resolution_V: float = 1e-4
    current_resolution_A: float = 1e-4
    temperature_resolution_K: float = 0.01
    voltage_offset_V: float = 0.0
    voltage_gain: float = 0.0
    current_offset_A: float = 0.0
    current_gain: float = 0.0
    temperature_offset_K: float = 0.0
    temperature_gain: float = 1.0

    def __post_init__(self) -> None:
        """Check the parameters once.

        Raises
        ------
        ValueError
            If one is not finite, or a noise or a resolution is negative.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            signed = "offset" in field.name or "gain" in field.name
            if not math.isfinite(value) or (value < 0.0 and not signed):
                raise ValueError(f"sensor parameter {field.name} is {value}; a finite number >= 0 is needed")


class Measurement(NamedTuple):
    """What the device reports of one instant."""

    voltage_V: float
    current_A: float
    temperature_degC: float
    ambient_degC: float


class MeasuringLayer(Protocol):
    """What a cycler needs of its sensors, so that faulty ones can be handed in."""

    def measure(self, truth: CellOutput, current_A: float, ambient_degC: float) -> Measurement:
        """Return one measurement of the truth."""
        ...

    @property
    def frozen(self) -> bool:
        """Whether nothing is measured any more."""
        ...


def _quantised(value: float, resolution: float) -> float:
    return round(value / resolution) * resolution if resolution > 0.0 else value


class Sensors:
    """Sensors with their noise source.

    Parameters
    ----------
    parameters : SensorParameters
    rng : numpy.random.Generator
        Four normal numbers are drawn for each measurement whatever the settings, so that two benches of one seed
        see the same noise and equal command sequences give equal records.
    """

    def __init__(self, parameters: SensorParameters, rng: np.random.Generator) -> None:
        self.parameters = parameters
        self._rng = rng

    frozen = False

    def measure(self, truth: CellOutput, current_A: float, ambient_degC: float) -> Measurement:
        """Return one measurement of the truth in volt, ampere and degC."""
        p = self.parameters
        noise_v, noise_i, noise_t, noise_a = self._rng.standard_normal(4).tolist()
        warmth = p.temperature_gain * (truth.temperature_degC - ambient_degC) + p.temperature_offset_K
        read_V, read_A = (1.0 + p.voltage_gain) * truth.voltage_V, (1.0 + p.current_gain) * current_A
        return Measurement(
            _quantised(read_V + p.voltage_offset_V + p.voltage_noise_V * noise_v, p.voltage_resolution_V),
            _quantised(read_A + p.current_offset_A + p.current_noise_A * noise_i, p.current_resolution_A),
            _quantised(ambient_degC + warmth + p.temperature_noise_K * noise_t, p.temperature_resolution_K),
            _quantised(ambient_degC + p.temperature_noise_K * noise_a, p.temperature_resolution_K),
        )
