"""The free run: what a model of a cell says of a run from its current and temperature alone."""

from __future__ import annotations

from functools import singledispatch

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.blocked_free_run import blocked_free_run_V, runs_in_blocks
from models.network.cell_model import CellModel
from models.network.local_model_network import LocalModelNetwork
from models.network.recursion import free_run


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
