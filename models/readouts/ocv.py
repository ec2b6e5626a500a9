"""Open-circuit voltage read out of a network, and the state of charge that a rest voltage stands for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from models.data.errors import ModelError
from models.data.lookup import nested_list, surface
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.readouts.steady_state import (
    OperatingPoints,
    outside_reservations,
    settled_voltage,
    soc_axis,
    standard_deviation,
    temperature_axis,
)
from models.uncertainty.spread import LocalFactor

SCHEMA_VERSION = 1
DIRECTIONS = (-1.0, 1.0)
_NAMES = {-1.0: "after discharge", 1.0: "after charge"}
# Without a band a fall of the curve below this is rounding.
_FALL_V = 1e-4
# The same for the voltage after charge below that after discharge: slow relaxation blurs the loop by about as much.
_INVERTED_V = 1e-3
# How far outside the table a rest voltage may lie, in standard deviations.
_BEYOND_STD = 4.0
_POSTERIOR_POINTS = 2001
_POSTERIOR_PASSES = 3


@dataclass(frozen=True)
class OcvTable:
    """Open-circuit voltage over direction, temperature and SoC.

    Attributes
    ----------
    soc : (n,) rising; temperature_degC : (m,) rising
    voltage_V : (2, m, n) after discharge and after charge
    std_V : the same shape, or None where no parameter covariance was given
    reservations : what a person should know before trusting the table
    """

    soc: FloatArray
    temperature_degC: FloatArray
    voltage_V: FloatArray
    std_V: FloatArray | None = None
    reservations: tuple[str, ...] = ()

    @property
    def mean_V(self) -> FloatArray:
        """(m, n) mean of the voltages after charge and after discharge."""
        return self.voltage_V.mean(axis=0)

    def branch_V(self, direction: float) -> FloatArray:
        """(m, n) voltages after charge (+1), after discharge (-1), or their mean (0)."""
        return self.mean_V if direction == 0.0 else self.voltage_V[1 if direction > 0.0 else 0]

    def at(self, soc: ArrayLike, temperature_degC: ArrayLike, direction: float = 0.0) -> FloatArray:
        """Voltages in V; on a straight line beyond the ends of the SoC, held beyond those of the temperature."""
        s, t = np.broadcast_arrays(np.asarray(soc, np.float64), np.asarray(temperature_degC, np.float64))
        values = np.ascontiguousarray(self.branch_V(direction))
        return _surface_at(self.temperature_degC, self.soc, values, t.ravel(), s.ravel()).reshape(s.shape)

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types; points that do not settle are null."""
        return {
            "schema_version": SCHEMA_VERSION,
            "kind": "ocv_table",
            "soc": self.soc.tolist(),
            "temperature_degC": self.temperature_degC.tolist(),
            "direction": list(DIRECTIONS),
            "voltage_V": nested_list(self.voltage_V),
            "mean_V": nested_list(self.mean_V),
            "std_V": None if self.std_V is None else nested_list(self.std_V),
            "reservations": list(self.reservations),
        }

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> OcvTable:
        """Read what `to_json` wrote.

        Raises
        ------
        ModelError
            It is no such table, or damaged.
        """
        known = isinstance(document, dict) and document.get("kind") == "ocv_table"
        if not known or document.get("schema_version") != SCHEMA_VERSION:
            raise ModelError(f"not an open-circuit table of schema version {SCHEMA_VERSION}")
        try:
            soc, temperature = np.array(document["soc"], float), np.array(document["temperature_degC"], float)
            voltage = np.array(document["voltage_V"], float)
            std = None if document["std_V"] is None else np.array(document["std_V"], float)
            reservations = tuple(document["reservations"])
        except (KeyError, TypeError, ValueError) as error:
            raise ModelError(f"open-circuit table is damaged: {error!r}") from None
        if voltage.shape != (2, len(temperature), len(soc)) or (std is not None and std.shape != voltage.shape):
            raise ModelError("open-circuit table is damaged: its shapes do not fit")
        return cls(soc, temperature, voltage, std, reservations)


def ocv_table(
    network: LocalModelNetwork,
    soc: ArrayLike | None = None,
    temperature_degC: ArrayLike | None = None,
    local: LocalFactor | None = None,
) -> OcvTable:
    """Open-circuit voltage of a network: no current, relaxation died out, direction held.

    Parameters
    ----------
    network : any structure
    soc, temperature_degC : axes; by default over the trained range
    local : factor of the covariance of the network's parameters in normalised units, for the bands

    Returns
    -------
    OcvTable
        With its physical reservations; NaN where the network does not settle.
    """
    s = soc_axis(network) if soc is None else np.atleast_1d(np.asarray(soc, np.float64))
    t = temperature_axis(network) if temperature_degC is None else np.atleast_1d(np.asarray(temperature_degC, float))
    shape = (2, len(t), len(s))
    points = OperatingPoints.grid(s, 0.0, np.array(DIRECTIONS)[:, None, None], t[:, None])
    settled = settled_voltage(network, points)
    voltage = settled.voltage_V.reshape(shape)
    std = None if local is None else standard_deviation(settled.gradient_V, local).reshape(shape)
    reservations = [
        *outside_reservations(network, {"soc": s, "temperature_degC": t}),
        *_physical_reservations(s, t, voltage, std),
    ]
    return OcvTable(s, t, voltage, std, tuple(reservations))


def soc_from_rest_voltage(
    table: OcvTable,
    voltage_V: float,
    voltage_std_V: float,
    *,
    temperature_degC: float | None = None,
    direction: float = 0.0,
) -> tuple[float, float]:
    """State of charge of a cell that has rested, for the start of a run.

    Parameters
    ----------
    table : open-circuit voltages
    voltage_V : measured after a rest
    voltage_std_V : of the measurement and of what has not relaxed yet; positive
    temperature_degC : of the cell; by default the middle of the table's
    direction : of the current before the rest: +1 charge, -1 discharge, 0 not known

    Returns
    -------
    (soc, std)
        Mean and standard deviation of the SoC, all values of the table being equally likely beforehand. This holds on
        a plateau too, where voltage over slope does not.

    Raises
    ------
    ModelError
        The standard deviation is not positive, or the voltage lies outside the table.

    Notes
    -----
    The table's own band counts where it has one; an unknown direction as an even distribution between the branches.
    """
    if not voltage_std_V > 0.0 or not np.isfinite(voltage_V):
        raise ModelError(f"rest voltage {voltage_V:g} V with {voltage_std_V:g} V; finite and positive are needed")
    temperature = float(np.mean(table.temperature_degC)) if temperature_degC is None else temperature_degC
    curve = table.at(table.soc, temperature, direction)
    variance = voltage_std_V**2 + _curve_variance(table, temperature, direction)
    beyond = max(curve.min() - voltage_V, voltage_V - curve.max())
    if not beyond <= _BEYOND_STD * np.sqrt(variance.max()):
        raise ModelError(
            f"rest voltage {voltage_V:.4f} V lies outside the open-circuit table, {curve.min():.4f}..{curve.max():.4f} "
            f"V at {temperature:g} degC: the cell has not rested, is another one, or the table does not reach as far"
        )
    return _posterior(table.soc, curve, variance, voltage_V)


def _posterior(soc: FloatArray, curve: FloatArray, variance: FloatArray, voltage_V: float) -> tuple[float, float]:
    """Mean and standard deviation over an even grid that closes in on where the likelihood is."""
    fine = weight = np.zeros(0)
    low, high = float(soc[0]), float(soc[-1])
    for _ in range(_POSTERIOR_PASSES):
        fine = np.linspace(low, high, _POSTERIOR_POINTS)
        v, var = np.interp(fine, soc, curve), np.interp(fine, soc, variance)
        log_likelihood = -0.5 * ((voltage_V - v) ** 2 / var + np.log(var))
        weight = np.exp(log_likelihood - log_likelihood.max())
        kept = np.flatnonzero(weight > 1e-12)
        low, high = fine[max(kept[0] - 1, 0)], fine[min(kept[-1] + 1, len(fine) - 1)]
    weight = weight / weight.sum()
    mean = float(weight @ fine)
    return mean, float(np.sqrt(weight @ (fine - mean) ** 2))


def _curve_variance(table: OcvTable, temperature_degC: float, direction: float) -> FloatArray:
    """(n,) variance of the table itself at one temperature, and of the direction where it is not known."""
    variance = np.zeros(len(table.soc))
    if table.std_V is not None:
        std = table.std_V.mean(axis=0) if direction == 0.0 else table.std_V[1 if direction > 0.0 else 0]
        at = _surface_at(
            table.temperature_degC,
            table.soc,
            np.ascontiguousarray(std),
            np.full(len(table.soc), temperature_degC),
            table.soc,
        )
        variance += at**2
    if direction == 0.0:
        apart = table.at(table.soc, temperature_degC, 1.0) - table.at(table.soc, temperature_degC, -1.0)
        variance += apart**2 / 12.0
    return variance


def _physical_reservations(
    soc: FloatArray, temperature_degC: FloatArray, voltage: FloatArray, std: FloatArray | None
) -> list[str]:
    found = []
    if np.isnan(voltage).any():
        found.append(f"the network does not settle at {int(np.isnan(voltage).sum())} of {voltage.size} points")
    for d, direction in enumerate(DIRECTIONS):
        for i, degC in enumerate(temperature_degC):
            step = np.diff(voltage[d, i])
            allowed = np.full(len(step), _FALL_V)
            if std is not None:
                allowed += 2.0 * np.maximum(std[d, i, 1:], std[d, i, :-1])
            falls = np.flatnonzero(step < -allowed)
            if len(falls):
                k = falls[np.argmin(step[falls])]
                found.append(
                    f"open-circuit voltage {_NAMES[direction]} falls by {-1e3 * step[k]:.2f} mV from SoC "
                    f"{soc[k]:.3f} to {soc[k + 1]:.3f} at {degC:g} degC ({len(falls)} such step(s))"
                )
    apart, allowed = voltage[1] - voltage[0], _INVERTED_V + (0.0 if std is None else 2.0 * np.hypot(std[0], std[1]))
    if (apart < -allowed).any():
        m, n = np.unravel_index(np.nanargmin(apart), apart.shape)
        found.append(
            f"open-circuit voltage after charge lies {-1e3 * apart[m, n]:.2f} mV below that after discharge at SoC "
            f"{soc[n]:.3f} and {temperature_degC[m]:g} degC; hysteresis has the other sign"
        )
    if np.nanmin(voltage, initial=np.inf) <= 0.0:
        found.append(f"open-circuit voltage reaches {np.nanmin(voltage):.3f} V; it must be positive")
    return found


@njit(cache=True)
def _surface_at(
    rows: np.ndarray, columns: np.ndarray, values: np.ndarray, row: np.ndarray, column: np.ndarray
) -> np.ndarray:
    out = np.empty(row.shape[0])
    for k in range(row.shape[0]):
        out[k] = surface(rows, columns, values, row[k], column[k], True)
    return out
