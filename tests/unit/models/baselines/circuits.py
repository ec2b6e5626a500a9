"""Cells in closed form, apart from models and simulators: exponentials of held currents, written as sums."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import TimeSeries
from tests.unit.models.synthetic import excitation_A

CAPACITY_AH = 1.0
R0_OHM = 0.02
R1_OHM, TAU1_S = 0.015, 8.0
R2_OHM, TAU2_S = 0.025, 90.0
M_V, M0_V, GAMMA = 0.02, 0.004, 25.0


def ocv_V(soc: np.ndarray) -> np.ndarray:
    """Open-circuit voltage in V."""
    return 3.4 + 0.7 * soc + 0.05 * np.sin(6.0 * soc)


def branch_V(current_A: np.ndarray, resistance_Ohm: np.ndarray | float, tau_s: float) -> np.ndarray:
    """Voltage of a resistor beside a capacitor at 1 s: the response to each current step, added up."""
    steps = np.diff(current_A, prepend=0.0)
    steps[0] = 0.0
    steps[1] = current_A[1]
    out = np.zeros(len(current_A))
    k = np.arange(len(current_A))
    for at in np.flatnonzero(steps):
        # A step at sample `at` flows from at - 1 on.
        out[at:] += steps[at] * -np.expm1(-(k[at:] - at + 1.0) / tau_s)
    return resistance_Ohm * out


def hysteresis(current_A: np.ndarray, gamma: float) -> tuple[np.ndarray, np.ndarray]:
    """State h and direction s at 1 s, one interval after the other from the analytic solution."""
    h, s = np.zeros(len(current_A)), np.zeros(len(current_A))
    for k in range(1, len(current_A)):
        s[k] = np.sign(current_A[k]) if current_A[k] else s[k - 1]
        moved = abs(current_A[k]) / (3600.0 * CAPACITY_AH)
        h[k] = s[k] + (h[k - 1] - s[k]) * np.exp(-gamma * moved)
    return h, s


def run(
    n: int,
    seed: int,
    *,
    temperature_degC: float = 25.0,
    factor: float = 1.0,
    with_hysteresis: bool = False,
    noise_V: float = 5e-4,
    initial_soc: float = 0.6,
) -> TimeSeries:
    """Two branches and, if asked for, hysteresis; `factor` is on all resistances and time constants."""
    rng = np.random.default_rng(seed)
    # Slow swings that move the charge beneath fast steps.
    current = excitation_A(n, rng, 2.0) + 1.2 * np.sign(np.sin(np.arange(n) * 2.0 * np.pi / 2400.0 + 0.3))
    current[0] = 0.0
    soc = initial_soc + np.concatenate([[0.0], np.cumsum(current[1:])]) / (3600.0 * CAPACITY_AH)
    voltage = ocv_V(soc) + factor * R0_OHM * current
    voltage += branch_V(current, factor * R1_OHM, factor * TAU1_S)
    voltage += branch_V(current, factor * R2_OHM, factor * TAU2_S)
    if with_hysteresis:
        h, s = hysteresis(current, GAMMA)
        voltage += M_V * h + M0_V * s
    voltage += noise_V * rng.standard_normal(n)
    temperature = np.full(n, temperature_degC)
    return TimeSeries(np.arange(n) * 1.0, current, voltage, temperature, None, soc, f"run {seed}")
