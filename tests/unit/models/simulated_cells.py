"""Records of the simulated truth cells as data for the models under test."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import TimeSeries
from models.readouts.ocv import OcvTable
from simulators.catalogue import CELLS
from simulators.cell import TruthCell

AMBIENT_DEGC = 22.0


def pulses_A(n: int, capacity_Ah: float, seed: int, c_rate: float = 2.0, rest: int = 0, soc: float = 0.6) -> np.ndarray:
    """Random pulses of 20 to 200 s between SoC 0.25 and 0.85, the last `rest` samples at rest; 1 s apart."""
    rng = np.random.default_rng(seed)
    current = np.zeros(n)
    k = 60
    while k < n - rest:
        length = min(int(rng.integers(20, 200)), n - rest - k)
        drawn = rng.uniform(-c_rate, c_rate) * capacity_Ah
        for candidate in (drawn, -drawn, 0.0):
            if 0.25 < soc + candidate * length / (3600.0 * capacity_Ah) < 0.85:
                break
        current[k : k + length] = candidate
        soc += candidate * length / (3600.0 * capacity_Ah)
        k += length
    return current


def record(
    cell: TruthCell, current_A: np.ndarray, seed: int, voltage_noise_V: float = 1e-3, ambient_degC: float = AMBIENT_DEGC
) -> TimeSeries:
    """Play a current through a cell, 1 s apart, and measure it with noise."""
    outputs = [cell.step(0.0, 0.0), *(cell.step(float(i), 1.0) for i in current_A[1:])]
    rng = np.random.default_rng(seed)
    n = len(current_A)
    voltage = np.array([out.voltage_V for out in outputs]) + voltage_noise_V * rng.standard_normal(n)
    temperature = np.array([out.temperature_degC for out in outputs]) + 0.02 * rng.standard_normal(n)
    soc = np.array([out.soc for out in outputs])
    return TimeSeries(np.arange(n) * 1.0, current_A, voltage, temperature, np.full(n, ambient_degC), soc, "simulated")


def true_ocv(name: str) -> OcvTable:
    """Open-circuit voltage of a simulated cell, hysteresis left out."""
    p = CELLS[name].parameters
    soc, temperature = np.linspace(0.0, 1.0, 401), np.array([0.0, 50.0])
    line = np.array([p.open_circuit.voltage_V(s) for s in soc])
    voltage = line + p.dU_dT_V_per_K * (temperature[:, None] - 25.0)
    return OcvTable(soc, temperature, np.array([voltage, voltage]))
