"""The free run: what a model of a cell says of a run from its current and temperature alone."""

from __future__ import annotations

from functools import singledispatch

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.blocked_free_run import blocked_free_run_V, runs_in_blocks
from models.network.cell_model import CellModel
from models.network.local_model_network import LocalModelNetwork
from models.network.recursion import free_run
from models.network.signals import parse_signal

# Hours in which a current can turn a hysteresis loop over; nothing before them counts.
LONGEST_MEMORY_S = 10_800.0
# Time constants after which nothing of a current is left: of a filter 2 %; past outputs are not scaled by a small gain.
MEMORY_OF_FILTERS, _MEMORY_OF_OUTPUTS = 4.0, 8.0


@singledispatch
def free_run_V(model: CellModel, run: GridRun, initial_soc: float) -> FloatArray:
    """Simulate a run from its current and temperature alone.

    Parameters
    ----------
    model : of a kind that has registered its own way to simulate
    run : on a grid of the model's sampling time
    initial_soc : fraction 0..1

    Returns
    -------
    (n,) voltage in V; of a network with output feedback the first measured values are used, as initial values.

    Raises
    ------
    TypeError
        Nothing is registered for this kind of model.
    """
    raise TypeError(f"{type(model).__name__} has no free run; register one with free_run_V.register")


@free_run_V.register
def _(model: LocalModelNetwork, run: GridRun, initial_soc: float) -> FloatArray:
    if runs_in_blocks(model, run):
        return blocked_free_run_V(model, run, initial_soc)
    data = model.dataset([run], [initial_soc])
    validity = model.partition.validity(data.z)
    return model.to_volts(free_run(model.theta, model.structure.output_order, validity, data))


@singledispatch
def memory_s(model: CellModel) -> float:
    """How long a model remembers a current, in s: what flowed earlier leaves nothing in its voltage.

    Models that register nothing of their own are taken to remember as long as any.
    """
    return LONGEST_MEMORY_S


@memory_s.register
def _(model: LocalModelNetwork) -> float:
    signals = [parse_signal(name) for name in model.structure.signals]
    if any(signal.get("rate") > 0.0 for signal in signals):
        return LONGEST_MEMORY_S
    slowest_s = max(signal.get("time_constant_s") for signal in signals)
    return min(max(MEMORY_OF_FILTERS * slowest_s, _memory_of_outputs_s(model)), LONGEST_MEMORY_S)


def _memory_of_outputs_s(model: LocalModelNetwork) -> float:
    """Of the slowest stable pole of any local model; 0 without past outputs."""
    order = model.structure.output_order
    sizes = [np.abs(np.roots([1.0, *-row[:order]])) for row in model.theta] if order else []
    stable = [float(size) for found in sizes for size in found if 0.0 < size < 1.0]
    return _MEMORY_OF_OUTPUTS * model.dt_s / -np.log(max(stable)) if stable else 0.0
