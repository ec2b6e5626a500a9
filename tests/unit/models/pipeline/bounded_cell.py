"""A simulated cell with a hysteresis loop, and bounded networks of it."""

from dataclasses import replace
from functools import cache

from models.data.timeseries import TimeSeries
from models.pipeline.fit import FitResult, fit_network
from simulators.cell import CellParameters
from tests.unit.models.diagnosis.cells import SOC, bare, measured

CELL: CellParameters = replace(bare(), hysteresis_amplitude_V=0.02)


@cache
def run(seed: int) -> TimeSeries:
    return measured(CELL, seed, 3000)


@cache
def fitted(structure: str = "bounded", without: tuple[str, ...] = ()) -> FitResult:
    """Of two runs from SoC 0.44 to 0.82, judged on a third between them."""
    return fit_network(
        [run(2), run(4)],
        capacity_Ah=CELL.capacity_Ah,
        structure=structure,
        without=without,
        initial_soc=[SOC, SOC],
        validate=[run(9)],
        validate_soc=[SOC],
        dt_s=1.0,
    )
