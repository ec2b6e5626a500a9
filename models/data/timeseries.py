"""Measured arrays of one run, validated once."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.data.errors import TimeSeriesError

FloatArray = NDArray[np.floating[Any]]

# Wider than any cell, module or chamber that a bench meets; narrower than a wrong unit (mV, mA, K).
_PLAUSIBLE = {
    "voltage_V": (-10.0, 2000.0),
    "current_A": (-20_000.0, 20_000.0),
    "temperature_degC": (-100.0, 200.0),
    "ambient_degC": (-100.0, 200.0),
    "soc_ref": (-0.5, 1.5),
}


@dataclass(frozen=True)
class TimeSeries:
    """One run as it was measured: unevenly spaced samples, NaN where a value is missing.

    Positive current charges the cell. `current_A[k]` is taken to have flowed from `time_s[k-1]` to `time_s[k]`
    (backward hold), which is how cyclers log steps.

    Attributes
    ----------
    time_s : (n,) strictly increasing, finite, in s
    current_A, voltage_V : (n,) in A and V
    temperature_degC : (n,) cell temperature in degC
    ambient_degC : (n,) in degC, or None
    soc_ref : (n,) reference state of charge 0..1, or None
    name : what a person calls the run

    Raises
    ------
    TimeSeriesError
        Lengths differ, fewer than two samples, time not strictly increasing, infinite or implausible values.
    """

    time_s: FloatArray
    current_A: FloatArray
    voltage_V: FloatArray
    temperature_degC: FloatArray
    ambient_degC: FloatArray | None = None
    soc_ref: FloatArray | None = None
    name: str = field(default="run")

    def __post_init__(self) -> None:
        """Convert to float64 and check."""
        for key in ("time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC", "soc_ref"):
            value = getattr(self, key)
            if value is not None:
                object.__setattr__(self, key, self._column(key, value))
        self._check_time()

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.time_s)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample in s."""
        return float(self.time_s[-1] - self.time_s[0])

    def _column(self, key: str, value: ArrayLike) -> FloatArray:
        column = np.ascontiguousarray(value, dtype=np.float64)
        if column.ndim != 1 or len(column) != len(self.time_s):
            raise TimeSeriesError(
                f"{self.name}: {key} has shape {column.shape}, time_s has {len(self.time_s)} samples; "
                "give one value for each sample"
            )
        bad = np.isinf(column)
        if bad.any():
            raise TimeSeriesError(f"{self.name}: {key} is infinite at sample {int(np.argmax(bad))}")
        if key in _PLAUSIBLE:
            low, high = _PLAUSIBLE[key]
            outside = (column < low) | (column > high)
            if outside.any():
                k = int(np.argmax(outside))
                raise TimeSeriesError(
                    f"{self.name}: {key} is {column[k]:g} at sample {k}, outside {low:g}..{high:g}; check its unit"
                )
        return column

    def _check_time(self) -> None:
        if len(self.time_s) < 2:
            raise TimeSeriesError(f"{self.name}: {len(self.time_s)} sample(s); at least 2 are needed")
        if np.isnan(self.time_s).any():
            raise TimeSeriesError(f"{self.name}: time_s is missing at sample {int(np.argmax(np.isnan(self.time_s)))}")
        step = np.diff(self.time_s)
        if (step <= 0).any():
            k = int(np.argmax(step <= 0))
            raise TimeSeriesError(
                f"{self.name}: time does not increase at sample {k + 1} "
                f"({self.time_s[k]:g} s then {self.time_s[k + 1]:g} s); "
                f"{int((step <= 0).sum())} such step(s). Remove duplicates or split the run there"
            )
