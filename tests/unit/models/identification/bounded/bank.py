"""Signals of short runs of a simulated cell."""

from dataclasses import replace
from functools import cache

import numpy as np

from models.data.resampling import to_grid
from models.identification.bounded.variants import Trials
from models.network.regression import CellContext, SignalBank
from simulators.cell import CellParameters
from tests.unit.models.diagnosis.cells import SOC, bare, measured

CELL: CellParameters = replace(bare(), hysteresis_amplitude_V=0.02)


@cache
def bank(
    cell: CellParameters = CELL, seeds: tuple[int, ...] = (1, 2), n: int = 3000, swing_K: float | None = None
) -> SignalBank:
    """Two runs; with `swing_K` their temperature goes up and down by as much, or not at all."""
    runs = [to_grid(measured(cell, seed, n), 1.0) for seed in seeds]
    if swing_K is not None:
        wave = 25.0 + swing_K * np.sin(np.arange(n) / 400.0)
        runs = [replace(run, temperature_degC=wave + 0.1 * number) for number, run in enumerate(runs)]
    return SignalBank(runs, [SOC] * len(runs), CellContext(cell.capacity_Ah))


def trials(without: tuple[str, ...] = (), cell: CellParameters = CELL) -> Trials:
    return Trials(bank(cell), without)
