"""Networks written down in volts, amperes and degrees, and normalised here, apart from the code under test."""

from __future__ import annotations

import numpy as np

from models.data.resampling import GridRun
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import ModelRecord
from models.network.partition import Partition, hat_partition, initial_partition
from models.network.regression import VOLTAGE, CellContext
from models.network.structure import InputChannel, PartitionAxis, Structure

DT_S = 1.0
CAPACITY_AH = 2.0
CELL = CellContext(CAPACITY_AH)
# Ranges without round numbers, so that a forgotten offset or factor shows.
SCALING = {
    VOLTAGE: (2.7, 4.31),
    "soc": (0.07, 0.93),
    "current": (-7.0, 5.0),
    "low_pass:30": (-6.0, 4.0),
    "relaxation:300": (-9.0, 8.0),
    "hysteresis": (-1.0, 1.0),
    "hysteresis_state:40": (-0.97, 0.99),
    "temperature": (4.0, 41.0),
    "temperature:5/30": (0.0, 40.0),
    "inverse_temperature": (1.0 / 314.0, 1.0 / 277.0),
    "scaled_current:2500": (-12.0, 8.0),
    "charge_transfer:3/2500/20": (-1.9, 1.6),
    "squared_current:60/3000": (-90.0, 60.0),
    "surface_soc:0.05/400/3500": (0.05, 0.95),
    "surface_soc:0.05/400/3500/30": (0.05, 0.95),
}


def network(
    structure: Structure, physical: np.ndarray, partition: Partition | None = None, scaling: dict | None = None
) -> LocalModelNetwork:
    """Normalise local models that are written in physical units.

    Each row: past outputs, input taps, offset of V(k) = sum a V(k-j) + sum b u + c in V.
    """
    bounds = {name: (scaling or SCALING)[name] for name in (*structure.signals, VOLTAGE)}
    order = structure.output_order
    low, high = bounds[VOLTAGE]
    theta = np.array(physical, dtype=np.float64)
    for i, row in enumerate(np.atleast_2d(physical)):
        offset = row[-1] - low + low * row[:order].sum()
        for j, (signal, _) in enumerate(structure.taps()):
            s_low, s_high = bounds[signal]
            theta[i, order + j] = row[order + j] * (s_high - s_low) / (high - low)
            offset += row[order + j] * s_low
        theta[i, -1] = offset / (high - low)
    domain = {"soc": [0.07, 0.93], "current_A": [-7.0, 5.0], "temperature_degC": [4.0, 41.0]}
    boxes = partition or initial_partition(structure.axes, structure.kernel)
    return LocalModelNetwork(structure, boxes, theta, bounds, CELL, ModelRecord.from_json({"domain": domain}))


def everything(order: int, kernel: str = "gaussian") -> LocalModelNetwork:
    """A network with every kind of signal, different in all its local models, and settling everywhere."""
    inputs = (
        InputChannel("soc", delay=1),
        InputChannel("current", order=2),
        InputChannel("low_pass:30", delay=1),
        InputChannel("relaxation:300"),
        InputChannel("hysteresis_state:40"),
        InputChannel("inverse_temperature"),
        InputChannel("scaled_current:2500"),
        InputChannel("charge_transfer:3/2500/20"),
        InputChannel("squared_current:60/3000"),
        InputChannel("surface_soc:0.05/400/3500", delay=1),
    )
    axes = (
        PartitionAxis("soc", initial=3, k_sigma=0.5),
        PartitionAxis("hysteresis", initial=2, k_sigma=0.25),
        PartitionAxis("temperature", initial=2, k_sigma=0.6),
        PartitionAxis("current", initial=2, k_sigma=0.8),
    )
    structure = Structure(order, inputs, axes, DT_S, kernel)
    rng = np.random.default_rng(11)
    count = initial_partition(axes, kernel).n_models
    poles = rng.uniform(0.5, 0.9, (count, 2))
    past = {
        0: np.zeros((count, 0)),
        1: poles[:, :1],
        2: np.column_stack([poles[:, 0] + 0.3, -0.3 * poles[:, 0]]),
    }[order]
    stationary = 1.0 - past.sum(axis=1, keepdims=True)
    gains = np.column_stack(
        [
            rng.uniform(0.2, 0.4, count),
            rng.uniform(0.003, 0.006, (count, 3)),
            rng.uniform(0.005, 0.010, count),
            rng.uniform(-0.008, -0.004, count),
            rng.uniform(0.005, 0.015, count),
            rng.uniform(20.0, 40.0, count),
            rng.uniform(0.001, 0.003, count),
            rng.uniform(0.01, 0.03, count),
            rng.uniform(0.0001, 0.0003, count),
            rng.uniform(0.2, 0.4, count),
            rng.uniform(3.2, 3.3, count),
        ]
    )
    return network(structure, np.hstack([past, stationary * gains]))


# Uneven, and with room beyond the outermost ones.
KNOTS = np.array([0.03, 0.08, 0.2, 0.37, 0.5, 0.71, 0.9, 0.96])


def hats(axis: str = "soc", knots: np.ndarray = KNOTS) -> LocalModelNetwork:
    """A network by hats with no state of charge among its inputs: the offset at each knot is the rest voltage."""
    inputs = (
        InputChannel("current"),
        InputChannel("low_pass:30", delay=1),
        InputChannel("hysteresis_state:40"),
        InputChannel("charge_transfer:3/2500/20"),
        InputChannel("squared_current:60/3000"),
        InputChannel("temperature"),
    )
    structure = Structure(0, inputs, (PartitionAxis(axis),), DT_S, "hat")
    low, high = SCALING[axis]
    soc, bend = low + (high - low) * knots, (knots - 0.6) ** 2
    rest_V = 3.2 + 0.8 * soc - 0.25 * np.exp(-soc / 0.08) + 0.05 * np.tanh((soc - 0.6) / 0.1)
    gains = [
        0.010 + 0.020 * bend,
        0.006 + 0.030 * bend,
        0.010 + 0.010 * bend,
        0.020 + 0.020 * bend,
        2e-4 + 2e-4 * bend,
        -3e-4 + 5e-4 * bend,
    ]
    return network(structure, np.column_stack([*gains, rest_V]), hat_partition(knots))


def grid_run(
    current_A: np.ndarray,
    temperature_degC: np.ndarray | float,
    ambient_degC: np.ndarray | float | None = None,
    counted: bool = True,
) -> GridRun:
    """A run on the grid without any measured voltage; not `counted`: the state of charge stays where it begins."""
    n = len(current_A)
    charge = np.concatenate([[0.0], np.cumsum(current_A[1:])]) * DT_S / 3600.0 * counted
    return GridRun(
        name="run",
        dt_s=DT_S,
        time_s=DT_S * np.arange(n),
        current_A=np.asarray(current_A, dtype=np.float64),
        voltage_V=np.full(n, np.nan),
        temperature_degC=np.broadcast_to(np.asarray(temperature_degC, dtype=np.float64), n).copy(),
        ambient_degC=None if ambient_degC is None else np.broadcast_to(np.asarray(ambient_degC, float), n).copy(),
        charge_Ah=charge,
        soc_ref=None,
        segment_starts=(0,),
        measured=np.zeros(n, dtype=bool),
    )
