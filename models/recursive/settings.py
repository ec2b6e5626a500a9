"""How fast, and how far, the parameters of a live network may move."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from models.data.errors import ModelError


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
