"""Tables over state of charge and temperature: piecewise linear, held at their edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from models.data.errors import StructureError
from models.data.timeseries import FloatArray


@dataclass(frozen=True)
class Axis:
    """Where samples lie between the knots of one axis.

    Attributes
    ----------
    knots : (K,) rising
    cell : (N,) knot to the left
    fraction : (N,) share of the way to the knot on the right, 0..1; outside the knots the nearest one holds
    """

    knots: FloatArray
    cell: np.ndarray
    fraction: FloatArray

    @property
    def size(self) -> int:
        """Number of knots."""
        return len(self.knots)


def locate(knots: FloatArray, values: FloatArray) -> Axis:
    """Find the neighbours of each value among rising knots; one knot means that the axis does not matter."""
    cell, fraction = np.zeros(len(values), dtype=np.int32), np.zeros(len(values))
    if len(knots) > 1:
        _locate(knots, values, cell, fraction)
    return Axis(knots, cell, fraction)


@dataclass(frozen=True)
class Table:
    """Values over state of charge and temperature.

    Attributes
    ----------
    soc : (S,) knots, fraction
    temperature_degC : (T,) knots
    values : (S, T) in the unit that the owner states

    A table with one knot on an axis does not depend on it.
    """

    soc: FloatArray
    temperature_degC: FloatArray
    values: FloatArray

    def __post_init__(self) -> None:
        """Check that knots rise and values are finite and of their shape."""
        for name in ("soc", "temperature_degC", "values"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float64))
        for name in ("soc", "temperature_degC"):
            check_knots(name, getattr(self, name))
        if self.values.shape != (len(self.soc), len(self.temperature_degC)) or not np.isfinite(self.values).all():
            raise StructureError(
                f"table: values of shape {self.values.shape} must be finite, "
                f"with {len(self.soc)} states of charge and {len(self.temperature_degC)} temperatures"
            )

    @property
    def needs_temperature(self) -> bool:
        """Whether the table depends on temperature."""
        return len(self.temperature_degC) > 1

    def at(self, soc: ArrayLike, temperature_degC: ArrayLike) -> FloatArray:
        """(N,) values at states of charge and temperatures, which broadcast against each other."""
        s, t = _pair(soc, temperature_degC)
        along, across = locate(self.soc, s), locate(self.temperature_degC, t)
        return _bilinear(along.cell, along.fraction, across.cell, across.fraction, self.values)

    def slope_at(self, soc: ArrayLike, temperature_degC: ArrayLike) -> FloatArray:
        """(N,) derivative with respect to the state of charge; beyond the knots that of the last cell."""
        s, t = _pair(soc, temperature_degC)
        if len(self.soc) == 1:
            return np.zeros(len(s))
        along, across = locate(self.soc, s), locate(self.temperature_degC, t)
        slopes = np.diff(self.values, axis=0) / np.diff(self.soc)[:, None]
        return _bilinear(along.cell, np.zeros(len(s)), across.cell, across.fraction, slopes)

    def to_json(self) -> dict[str, Any]:
        """Return plain types."""
        return {
            "soc": self.soc.tolist(),
            "temperature_degC": self.temperature_degC.tolist(),
            "values": self.values.tolist(),
        }

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Table:
        """Read what `to_json` wrote."""
        return cls(*(np.array(document[key], dtype=np.float64) for key in ("soc", "temperature_degC", "values")))


def check_knots(name: str, knots: FloatArray) -> None:
    """Refuse knots that do not rise.

    Raises
    ------
    StructureError
        There is none, one is not finite, or two do not rise.
    """
    if knots.ndim != 1 or len(knots) == 0 or not np.isfinite(knots).all() or (np.diff(knots) <= 0.0).any():
        raise StructureError(f"knots of {name} must be finite and rise")


def _pair(soc: ArrayLike, temperature_degC: ArrayLike) -> tuple[FloatArray, FloatArray]:
    s, t = np.broadcast_arrays(
        np.atleast_1d(np.asarray(soc, dtype=np.float64)), np.atleast_1d(np.asarray(temperature_degC, dtype=np.float64))
    )
    return np.ascontiguousarray(s), np.ascontiguousarray(t)


@njit(cache=True)
def _locate(knots: np.ndarray, values: np.ndarray, cell: np.ndarray, fraction: np.ndarray) -> None:
    # Neighbouring samples lie close together: the search goes on from the last cell.
    last, top = 0, len(knots) - 2
    for k in range(len(values)):
        x = values[k]
        while last < top and x >= knots[last + 1]:
            last += 1
        while last > 0 and x < knots[last]:
            last -= 1
        cell[k] = last
        fraction[k] = min(max((x - knots[last]) / (knots[last + 1] - knots[last]), 0.0), 1.0)


@njit(cache=True)
def _bilinear(
    soc_cell: np.ndarray, soc_fraction: np.ndarray, t_cell: np.ndarray, t_fraction: np.ndarray, values: np.ndarray
) -> np.ndarray:
    out = np.empty(len(soc_cell))
    n_soc, n_temperature = values.shape
    for k in range(len(out)):
        i, f, j, g = soc_cell[k], soc_fraction[k], t_cell[k], t_fraction[k]
        low, high = min(i + 1, n_soc - 1), min(j + 1, n_temperature - 1)
        upper = (1.0 - g) * values[i, j] + g * values[i, high]
        lower = (1.0 - g) * values[low, j] + g * values[low, high]
        out[k] = (1.0 - f) * upper + f * lower
    return out
