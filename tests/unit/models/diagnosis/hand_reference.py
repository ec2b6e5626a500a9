"""A reference model that is written down, not fitted: a straight open-circuit curve and one resistance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from models.data.resampling import GridRun
from models.diagnosis.evidence.candidates import Comparison
from models.diagnosis.evidence.evidence import Evidence
from models.diagnosis.reference.layout import OCV_BUMPS, Layout, Shape
from models.diagnosis.reference.reference import Reference
from models.diagnosis.reference.samples import all_samples
from models.effects import effect
from tests.unit.models.hand_network import CAPACITY_AH, DT_S, grid_run

EMPTY_V, SLOPE_V, RESISTANCE_OHM = 3.4, 0.7, 0.02
SOC = 0.5
# Information on every coefficient.
_SURE = 1e9
DOMAIN = {"soc": (0.1, 0.9), "current_A": (-4.0, 4.0)}
WARM_DOMAIN = {**DOMAIN, "temperature_degC": (15.0, 35.0)}


def layout(with_temperature: bool = False, shape: Shape | None = None) -> Layout:
    return Layout(CAPACITY_AH, DT_S, DOMAIN["soc"], shape or Shape(), with_temperature)


def reference(with_temperature: bool = False, shape: Shape | None = None, penalty: float = 0.0) -> Reference:
    """Voltage = 3.4 V + 0.7 V soc + 0.02 Ohm current; bumps at their centres make the straight line exactly.

    A penalty pulls every direction of the coefficients but their own, as if they had been fitted with it.
    """
    plan = layout(with_temperature, shape)
    coefficients = np.zeros(plan.size)
    coefficients[plan.blocks[0].part] = EMPTY_V + SLOPE_V * plan.bases[OCV_BUMPS].centres
    coefficients[plan.blocks[1].part] = RESISTANCE_OHM
    domain = WARM_DOMAIN if with_temperature else DOMAIN
    pull = np.eye(plan.size) - np.outer(coefficients, coefficients) / (coefficients @ coefficients)
    return Reference(plan, coefficients, penalty * pull, domain, 1e-3, 1.2e-3)


def steps_A(n: int, seed: int = 0, largest_A: float = 3.0, length: int = 40) -> np.ndarray:
    """Random steps without net charge, every other one a rest; the largest has the size that is asked for."""
    rng = np.random.default_rng(seed)
    length = min(length, n // 6)
    levels = rng.uniform(-1.0, 1.0, n // length + 1)
    levels[1::2] = 0.0
    current = np.repeat(levels, length)[:n]
    current = np.where(current != 0.0, current - current.sum() / np.count_nonzero(current), 0.0)
    return largest_A / np.abs(current).max() * current


def true_run(
    current_A: np.ndarray,
    *,
    soc: float = SOC,
    capacity_Ah: float = CAPACITY_AH,
    added_V: np.ndarray | float = 0.0,
    noise_V: float = 0.0,
    temperature_degC: np.ndarray | float = 25.0,
    ambient_degC: np.ndarray | float | None = None,
    seed: int = 0,
) -> GridRun:
    """What the cell of the reference model gives, with another capacity or a voltage on top."""
    run = grid_run(current_A, temperature_degC, ambient_degC)
    true_soc = soc + run.charge_Ah / capacity_Ah
    noise = noise_V * np.random.default_rng(seed).standard_normal(len(run))
    voltage_V = EMPTY_V + SLOPE_V * true_soc + RESISTANCE_OHM * run.current_A + added_V + noise
    return replace(run, voltage_V=voltage_V, measured=np.ones(len(run), dtype=bool))


def compared(
    run: GridRun, names: Sequence[str], model: Reference | None = None, own_mse: float = 1e-8, noise_mse: float = 1e-8
) -> Comparison:
    """A run against the hand-made model, of whose coefficients the training runs were sure."""
    samples = all_samples(model or reference(), [run], [SOC], 100_000)
    chosen = tuple(effect(name) for name in names)
    columns = {one.name: samples.regressors(one) for one in chosen}
    own = samples.views[0].model
    assert isinstance(own, Reference)
    both = np.hstack([samples.own_regressors(own), *columns.values()])
    evidence = Evidence(samples.error_V, both, _SURE * np.eye(both.shape[1]), samples.blocks)
    return Comparison(samples, chosen, columns, evidence, own_mse, noise_mse)
