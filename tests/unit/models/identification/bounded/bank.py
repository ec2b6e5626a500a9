"""Signals of short runs of a simulated cell."""

from dataclasses import replace
from functools import cache

import numpy as np

from models.data.resampling import to_grid
from models.data.timeseries import FloatArray
from models.identification.bounded.variants import Trials
from models.network.regression import CellContext, SignalBank
from simulators.cell import CellParameters
from tests.unit.models.diagnosis.cells import SOC, bare, measured

# Of a sphere whose slowest time constant is 268 s.
SLOW_SURFACE = "surface_soc:0.1/268/3500"
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


def stepped_V(surface: FloatArray) -> FloatArray:
    """Potential of the electrode that diffuses slowly."""
    return 3.4 + 0.05 * np.tanh((surface - 0.5) / 0.015)


def two_electrodes(slope_V: float, surface: str = SLOW_SURFACE, seeds: tuple[int, ...] = (1, 2)) -> SignalBank:
    """One electrode's curve steps where its own surface stands, the other one's rises evenly with the mean."""
    plain, rng = bank(seeds=seeds, n=6000), np.random.default_rng(5)
    runs = [
        replace(
            run,
            voltage_V=stepped_V(at) + slope_V * soc + 0.02 * run.current_A + rng.normal(0.0, 5e-4, len(run)),
        )
        for run, at, soc in zip(plain.runs, plain.values(surface), plain.values("soc"), strict=True)
    ]
    return SignalBank(runs, plain.initial_soc, plain.cell)


def lead_V(two: SignalBank) -> FloatArray:
    """(n,) of the first run, what the surface that runs ahead makes of the voltage."""
    return stepped_V(two.values(SLOW_SURFACE)[0]) - stepped_V(two.values("soc")[0])
