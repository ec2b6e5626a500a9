"""Extended and unscented Kalman filters on an equivalent circuit, and plain counting, to compare with.

State: [SoC, current through each branch's resistor in A]. They have the interface of the fuzzy observer.

Notes
-----
Extended: Plett, J. Power Sources 134, 2004, part 3. Unscented: Julier and Uhlmann, Proc. IEEE 92, 2004, with the
symmetric set of 2 s points of equal weight (cubature points; Arasaratnam and Haykin, IEEE Trans. Autom. Control 54,
2009), which has nothing to tune.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.baselines import EquivalentCircuit
from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.observer.filter.places import SOC_SLACK

KINDS = ("extended", "unscented", "counting")
# How far beyond empty and full the tables are read.
_SLACK = 0.05


@dataclass(frozen=True)
class CircuitState:
    """Mean and covariance of [SoC, branch currents], and the last known current and temperature."""

    x: FloatArray
    covariance: FloatArray
    current_A: float
    temperature_degC: float
    seen: bool


@dataclass(frozen=True)
class CircuitSettings:
    """Noise of the filters.

    Attributes
    ----------
    voltage_std_V : of the measurement with the model's error; None: twice the model's held-out error
    soc_std_per_sqrt_s : random walk of the SoC
    branch_std_A : process noise of each branch current per sample
    initial_soc_std : uncertainty of the initial SoC
    """

    voltage_std_V: float | None = None
    soc_std_per_sqrt_s: float = 2e-5
    branch_std_A: float = 1e-3
    initial_soc_std: float = 0.2


class CircuitObserver:
    """A Kalman filter on an equivalent circuit.

    Parameters
    ----------
    circuit : fitted circuit with any number of branches
    kind : one of KINDS
    settings : noise

    Raises
    ------
    ModelError
        The kind is unknown.
    """

    def __init__(self, circuit: EquivalentCircuit, kind: str, settings: CircuitSettings | None = None) -> None:
        if kind not in KINDS:
            raise ModelError(f"filter {kind!r} is unknown; use one of {', '.join(KINDS)}")
        self.circuit, self.kind = circuit, kind
        self.settings = settings or CircuitSettings()
        self.dt_s = circuit.dt_s
        held_out_mV = circuit.record.held_out_rmse_mV
        held_out_V = 1e-3 * (5.0 if held_out_mV is None else held_out_mV)
        self._voltage_std_V = self.settings.voltage_std_V or 2.0 * max(held_out_V, 1e-3)
        self._soc_per_A = self.dt_s / (3600.0 * circuit.cell.capacity_Ah)
        self._tables = [circuit.ocv_V, circuit.r0_Ohm, *circuit.branches.resistances_Ohm]

    def initial(self, soc: float, soc_std: float | None = None, temperature_degC: float = 25.0) -> CircuitState:
        """State of a rested cell."""
        size = 1 + len(self.circuit.branches.resistances_Ohm)
        covariance = np.zeros((size, size))
        covariance[0, 0] = (self.settings.initial_soc_std if soc_std is None else soc_std) ** 2
        x = np.zeros(size)
        x[0] = soc
        return CircuitState(x, covariance, 0.0, temperature_degC, False)

    def replay(
        self, state: CircuitState, current_A: FloatArray, voltage_V: FloatArray, temperature_degC: FloatArray
    ) -> tuple[CircuitState, FloatArray]:
        """Run over whole arrays; columns as the first five of `ObserverOutput`."""
        out = np.empty((len(current_A), 5))
        for k, sample in enumerate(zip(current_A.tolist(), voltage_V.tolist(), temperature_degC.tolist(), strict=True)):
            state, out[k] = self.step(state, *sample)
        return state, out

    def step(
        self, state: CircuitState, current_A: float, voltage_V: float, temperature_degC: float
    ) -> tuple[CircuitState, FloatArray]:
        """One sample; NaN marks a missing value."""
        current = state.current_A if np.isnan(current_A) else current_A
        degC = state.temperature_degC if np.isnan(temperature_degC) else temperature_degC
        x, p = state.x.copy(), state.covariance
        if state.seen:
            keep = self._keep(degC)
            x[0] += self._soc_per_A * (self.circuit.cell.efficiency if current > 0.0 else 1.0) * current
            x[1:] = keep * x[1:] + (1.0 - keep) * current
            moved = np.concatenate([[1.0], keep])
            p = p * np.outer(moved, moved)
            p[0, 0] += self.settings.soc_std_per_sqrt_s**2 * self.dt_s
            p[range(1, len(x)), range(1, len(x))] += self.settings.branch_std_A**2
        expected, seen, variance = self._output(x, p, current, degC)
        innovation = voltage_V - expected
        if self.kind != "counting" and not np.isnan(voltage_V):
            gain = seen / variance
            x += gain * innovation
            x[0] = min(max(x[0], -SOC_SLACK), 1.0 + SOC_SLACK)
            p = p - np.outer(gain, gain) * variance
        row = np.array([x[0], np.sqrt(max(p[0, 0], 0.0)), expected, innovation, np.sqrt(variance)])
        return CircuitState(x, p, current, degC, True), row

    def _keep(self, temperature_degC: float) -> FloatArray:
        """(n,) share of each branch current that is left after a sample."""
        branches = self.circuit.branches
        log_s = [np.interp(temperature_degC, branches.temperature_degC, np.log(r)) for r in branches.time_constants_s]
        return np.exp(-self.dt_s / np.exp(np.array(log_s)))

    def _output(
        self, x: FloatArray, p: FloatArray, current_A: float, temperature_degC: float
    ) -> tuple[float, FloatArray, float]:
        """Expected voltage, its covariance with the state, and its variance with the measurement's."""
        noise = self._voltage_std_V**2
        if self.kind == "unscented":
            root = np.sqrt(len(x)) * _root(p)
            points = np.vstack([x + root.T, x - root.T])
            volts = self._voltage_V(points, current_A, temperature_degC)
            mean = float(volts.mean())
            off = volts - mean
            return mean, (points - x).T @ off / len(volts), float(off @ off / len(volts)) + noise
        tables = self._tables
        row = np.array([float(table.at(x[0], temperature_degC)[0]) for table in tables])
        slopes = np.array([float(table.slope_at(x[0], temperature_degC)[0]) for table in tables])
        factors = np.concatenate([[1.0, current_A], x[1:]])
        c = np.concatenate([[float(slopes @ factors)], row[2:]])
        seen = p @ c
        return float(row @ factors), seen, float(c @ seen) + noise

    def _voltage_V(self, points: FloatArray, current_A: float, temperature_degC: float) -> FloatArray:
        soc = np.clip(points[:, 0], -_SLACK, 1.0 + _SLACK)
        volts = self._tables[0].at(soc, temperature_degC) + self._tables[1].at(soc, temperature_degC) * current_A
        for branch, table in enumerate(self._tables[2:]):
            volts = volts + table.at(soc, temperature_degC) * points[:, 1 + branch]
        return volts


def _root(p: FloatArray) -> FloatArray:
    """Matrix root of a covariance that may be singular."""
    values, vectors = np.linalg.eigh(p)
    return vectors * np.sqrt(np.maximum(values, 0.0))
