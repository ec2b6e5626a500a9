"""Runs whose temperature follows a heat balance that is written down: 20 K/W, 400 s."""

from dataclasses import replace

import numpy as np

from models.data.resampling import GridRun
from models.diagnosis.thermal.heat_balance import HeatBalance
from tests.unit.models.diagnosis.hand_reference import RESISTANCE_OHM, steps_A, true_run
from tests.unit.models.hand_network import DT_S

RESISTANCE_K_PER_W, TIME_CONSTANT_S = 20.0, 400.0
AMBIENT_DEGC = 22.0
BALANCE = HeatBalance(RESISTANCE_K_PER_W, TIME_CONSTANT_S, 0.0, 1e-4)


def warmed(
    heat_W: np.ndarray, resistance_K_per_W: float = RESISTANCE_K_PER_W, time_constant_s: float = TIME_CONSTANT_S
) -> np.ndarray:
    """Temperature by stepping T(k) = a T(k-1) + (1 - a) (ambient + K P(k)) from ambient on."""
    keep, rise = np.exp(-DT_S / time_constant_s), 0.0
    out = np.empty(len(heat_W))
    for k, power in enumerate(heat_W):
        rise = keep * rise + (1.0 - keep) * resistance_K_per_W * power
        out[k] = AMBIENT_DEGC + rise
    return out


def warm_run(n: int = 5000, seed: int = 0, added_W: np.ndarray | float = 0.0, **balance: float) -> GridRun:
    """Steps through the hand-made cell; what warms it is R I^2 and what is added."""
    current = steps_A(n, seed, largest_A=4.0, length=300)
    run = true_run(current, ambient_degC=AMBIENT_DEGC)
    temperature = warmed(RESISTANCE_OHM * current**2 + added_W, **balance)
    noise = 0.01 * np.random.default_rng(seed).standard_normal(n)
    return replace(run, temperature_degC=temperature + noise)
