"""Short records of simulated cells, before and after something changes."""

from dataclasses import replace
from functools import cache

import numpy as np

from models.data.timeseries import TimeSeries
from models.network.local_model_network import LocalModelNetwork
from models.network.partition import Partition
from models.network.regression import CellContext
from models.network.structure import InputChannel, PartitionAxis, Structure
from simulators.catalogue import CELLS
from simulators.cell import Branch, Cell, CellParameters
from tests.unit.models.simulated_cells import pulses_A, record

SOC = 0.6


def bare() -> CellParameters:
    """Open-circuit curve, resistance and two fast pairs."""
    p = CELLS["nmc"].parameters
    return replace(
        p,
        ohmic_at_empty_Ohm=0.0,
        slow=Branch(0.0, 900.0),
        hysteresis_amplitude_V=0.0,
        charge_transfer_V=0.0,
        activation_K=0.0,
        dU_dT_V_per_K=0.0,
    )


@cache
def measured(cell: CellParameters, seed: int, n: int = 6000, current_error_A: float = 0.0) -> TimeSeries:
    current = pulses_A(n, cell.capacity_Ah, seed, rest=300)
    series = record(Cell(cell, SOC, 22.0), current, seed)
    return replace(series, current_A=current + current_error_A, name=f"seed {seed}")


def simple_network(capacity_Ah: float, *axes: PartitionAxis) -> LocalModelNetwork:
    """One local line: a model that simulates, however badly; change mode takes its figures from it and no more."""
    inputs = (InputChannel("soc", delay=1), InputChannel("current"))
    structure = Structure(0, inputs, (PartitionAxis("soc"), *axes), 1.0)
    scaling = {"soc": (0.0, 1.0), "current": (-5.0, 5.0), "voltage": (3.0, 4.2), "hysteresis": (-1.0, 1.0)}
    n_axes = len(structure.axes)
    partition = Partition(np.zeros((1, n_axes)), np.ones((1, n_axes)), np.full(n_axes, 0.5), "gaussian")
    return LocalModelNetwork(structure, partition, np.array([[0.7, 0.35, -0.1]]), scaling, CellContext(capacity_Ah))
