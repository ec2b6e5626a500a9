"""Internal resistance read out of a network's settled voltage, as a table for thermal models and for people."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from models.data.errors import ModelError
from models.data.lookup import nested_list, volume
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.readouts.steady_state import (
    OperatingPoints,
    current_axis,
    outside_reservations,
    settled_voltage,
    soc_axis,
    standard_deviation,
    temperature_axis,
)
from models.uncertainty.spread import LocalFactor

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class ResistanceTable:
    """Static resistance (V(I) - V(0)) / I over current, temperature and SoC, all dynamics settled.

    The sign of the current is the direction; V(0) is the open-circuit voltage of that direction, so hysteresis is no
    part of the resistance.

    Attributes
    ----------
    current_A : (c,) rising, without zero; temperature_degC : (m,) rising; soc : (n,) rising
    resistance_Ohm : (c, m, n), NaN where the network does not settle
    std_Ohm : the same shape, or None where no parameter covariance was given
    reservations : what a person should know before trusting the table
    """

    current_A: FloatArray
    temperature_degC: FloatArray
    soc: FloatArray
    resistance_Ohm: FloatArray
    std_Ohm: FloatArray | None = None
    reservations: tuple[str, ...] = ()

    def at(self, soc: ArrayLike, current_A: ArrayLike, temperature_degC: ArrayLike) -> FloatArray:
        """Resistances in ohm; beyond the axes the nearest point counts, and current stays in its own direction."""
        current, temperature, s = np.broadcast_arrays(
            np.asarray(current_A, np.float64), np.asarray(temperature_degC, np.float64), np.asarray(soc, np.float64)
        )
        flat = volume_at(
            self.current_A,
            self.temperature_degC,
            self.soc,
            self.resistance_Ohm,
            current.ravel(),
            temperature.ravel(),
            s.ravel(),
        )
        return flat.reshape(s.shape)

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types; points that do not settle are null."""
        return {
            "schema_version": SCHEMA_VERSION,
            "kind": "resistance_table",
            "current_A": self.current_A.tolist(),
            "temperature_degC": self.temperature_degC.tolist(),
            "soc": self.soc.tolist(),
            "resistance_Ohm": nested_list(self.resistance_Ohm),
            "std_Ohm": None if self.std_Ohm is None else nested_list(self.std_Ohm),
            "reservations": list(self.reservations),
        }

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> ResistanceTable:
        """Read what `to_json` wrote.

        Raises
        ------
        ModelError
            It is no such table, or damaged.
        """
        known = isinstance(document, dict) and document.get("kind") == "resistance_table"
        if not known or document.get("schema_version") != SCHEMA_VERSION:
            raise ModelError(f"not a resistance table of schema version {SCHEMA_VERSION}")
        try:
            current, temperature = np.array(document["current_A"], float), np.array(document["temperature_degC"], float)
            soc = np.array(document["soc"], float)
            resistance = np.array(document["resistance_Ohm"], float)
            std = None if document["std_Ohm"] is None else np.array(document["std_Ohm"], float)
            reservations = tuple(document["reservations"])
        except (KeyError, TypeError, ValueError) as error:
            raise ModelError(f"resistance table is damaged: {error!r}") from None
        expected = (len(current), len(temperature), len(soc))
        if resistance.shape != expected or (std is not None and std.shape != expected):
            raise ModelError("resistance table is damaged: its shapes do not fit")
        return cls(current, temperature, soc, resistance, std, reservations)


def resistance_table(
    network: LocalModelNetwork,
    soc: ArrayLike | None = None,
    current_A: ArrayLike | None = None,
    temperature_degC: ArrayLike | None = None,
    local: LocalFactor | None = None,
) -> ResistanceTable:
    """Static resistance of a network.

    Parameters
    ----------
    network : any structure
    soc, current_A, temperature_degC : axes, rising; by default over the trained range. No current may be zero
    local : factor of the covariance of the network's parameters in normalised units, for the bands

    Returns
    -------
    ResistanceTable
        With its physical reservations.

    Raises
    ------
    ModelError
        A current is zero, or an axis does not rise.
    """
    s = soc_axis(network) if soc is None else np.atleast_1d(np.asarray(soc, np.float64))
    i = current_axis(network) if current_A is None else np.atleast_1d(np.asarray(current_A, np.float64))
    t = temperature_axis(network) if temperature_degC is None else np.atleast_1d(np.asarray(temperature_degC, float))
    for name, axis in (("soc", s), ("current_A", i), ("temperature_degC", t)):
        if len(axis) == 0 or (np.diff(axis) <= 0.0).any() or (name == "current_A" and (axis == 0.0).any()):
            raise ModelError(f"resistance table: {name} must rise from value to value, and no current may be zero")
    shape = (len(i), len(t), len(s))
    held, degC = i[:, None, None], t[:, None]
    points = OperatingPoints.grid(s, held, np.sign(held), degC)
    loaded = settled_voltage(network, points)
    rested = settled_voltage(network, OperatingPoints.grid(s, 0.0 * held, np.sign(held), degC))
    resistance = ((loaded.voltage_V - rested.voltage_V) / points.current_A).reshape(shape)
    std = None
    if local is not None:
        gradient = (loaded.gradient_V - rested.gradient_V) / points.current_A[:, None]
        std = standard_deviation(gradient, local).reshape(shape)
    reservations = [
        *outside_reservations(network, {"soc": s, "current_A": i, "temperature_degC": t}),
        *_physical_reservations(i, t, s, resistance),
    ]
    return ResistanceTable(i, t, s, resistance, std, tuple(reservations))


def _physical_reservations(
    current_A: FloatArray, temperature_degC: FloatArray, soc: FloatArray, resistance: FloatArray
) -> list[str]:
    found = []
    missing = int(np.isnan(resistance).sum())
    if missing:
        found.append(f"the network does not settle at {missing} of {resistance.size} points")
    bad = resistance <= 0.0
    if bad.any():
        c, m, n = np.unravel_index(np.nanargmin(resistance), resistance.shape)
        found.append(
            f"resistance is not positive at {int(bad.sum())} of {resistance.size} points, least "
            f"{1e3 * resistance[c, m, n]:.3f} mOhm at {current_A[c]:g} A, {temperature_degC[m]:g} degC and "
            f"SoC {soc[n]:.3f}"
        )
    return found


@njit(cache=True)
def in_own_direction(current: np.ndarray, current_A: float) -> float:
    """Move a current to the nearest one of the axis that has its sign, if it lies between the smallest of both.

    Towards zero the resistance of a direction goes on at that of its smallest current.
    """
    split = np.searchsorted(current, 0.0)
    if current_A > 0.0 and split < current.shape[0]:
        return max(current_A, current[split])
    if current_A < 0.0 and split > 0:
        return min(current_A, current[split - 1])
    return current_A


@njit(cache=True)
def volume_at(
    layers: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    values: np.ndarray,
    layer: np.ndarray,
    row: np.ndarray,
    column: np.ndarray,
) -> np.ndarray:
    """Values of a resistance table at many points."""
    out = np.empty(layer.shape[0])
    for k in range(layer.shape[0]):
        out[k] = volume(layers, rows, columns, values, in_own_direction(layers, layer[k]), row[k], column[k])
    return out
