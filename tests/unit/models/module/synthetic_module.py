"""A module of `synthetic`'s cells: groups that differ, and a resistance and an offset beside them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from models.module.log import ModuleLog
from tests.unit.models import synthetic

SERIES, PARALLEL = 3, 2
CAPACITY_AH = PARALLEL * synthetic.CAPACITY_AH
RESISTANCE_OHM, OFFSET_V = 0.012, -0.05
# Of the second group: it holds less, and stands lower.
CAPACITY_SHARE, SOC_OFFSET, MORE_OHM = 0.93, -0.02, 0.002


def log(
    n: int,
    seed: int,
    *,
    alike: bool = False,
    sensed: bool = True,
    initial_soc: float = 0.6,
    offset_at_soc: float | None = None,
) -> ModuleLog:
    """One run of the module, with 1 mV of noise on every voltage.

    The second group stands lower by `SOC_OFFSET` where the others are at `offset_at_soc`, by default at the start.
    """
    rng = np.random.default_rng(seed)
    # A slow swing under the steps, so that a group that holds less drifts away.
    cell_A = synthetic.excitation_A(n, rng) + 1.5 * np.sin(np.arange(n) / n * 4.0 * np.pi)
    cell_A[0] = 0.0
    soc, at_soc = initial_soc + _counted(cell_A), initial_soc if offset_at_soc is None else offset_at_soc
    groups = [_group_V(cell_A, soc, at_soc, k == 1 and not alike) for k in range(SERIES)]
    groups_V = np.column_stack(groups) + 1e-3 * rng.standard_normal((n, SERIES))
    module_A = PARALLEL * cell_A
    voltage_V = np.sum(groups, axis=0) + RESISTANCE_OHM * module_A + OFFSET_V + 1e-3 * rng.standard_normal(n)
    run = replace(
        synthetic.run(n, seed, name=f"module {seed}"),
        current_A=module_A,
        voltage_V=voltage_V,
        soc_ref=soc,
    )
    return ModuleLog(run, groups_V if sensed else None)


def written(path: Path, seed: int) -> Path:
    """Write a run of 1200 s as a table, with the voltage of each group."""
    made = log(1200, seed)
    run, groups_V = made.run, made.groups_V
    assert run.soc_ref is not None and groups_V is not None
    header = ["time_s", "current_A", "voltage_V", "temperature_degC", "soc_ref"]
    header += [f"v_cell{k + 1}_V" for k in range(SERIES)]
    columns = [run.time_s, run.current_A, run.voltage_V, run.temperature_degC, run.soc_ref, *groups_V.T]
    np.savetxt(path, np.column_stack(columns), fmt="%.6f", delimiter=",", header=",".join(header), comments="")
    return path


def _counted(cell_A: np.ndarray) -> np.ndarray:
    moved = np.concatenate([[0.0], np.cumsum(cell_A[1:])])
    return moved / (3600.0 * synthetic.CAPACITY_AH)


def _group_V(cell_A: np.ndarray, soc: np.ndarray, at_soc: float, weak: bool) -> np.ndarray:
    share, offset, more_Ohm = (CAPACITY_SHARE, SOC_OFFSET, MORE_OHM) if weak else (1.0, 0.0, 0.0)
    pole, slow = np.exp(-1.0 / synthetic.TAU_S), np.zeros(len(cell_A))
    for k in range(1, len(cell_A)):
        slow[k] = pole * slow[k - 1] + (1.0 - pole) * synthetic.R1_OHM * cell_A[k]
    at = synthetic.ocv_V(at_soc + offset + (soc - at_soc) / share)
    # Of the whole group; through it flows what flows through all its cells.
    return at + synthetic.R0_OHM * cell_A + slow + more_Ohm * PARALLEL * cell_A
