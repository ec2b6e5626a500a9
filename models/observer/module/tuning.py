"""Noise of a module's observer, tuned with the module's own runs where its cell was identified from them too."""

from __future__ import annotations

from dataclasses import replace

from models.data.timeseries import TimeSeries
from models.module.network import ModuleNetwork
from models.observer.filter.fuzzy_observer import FuzzyObserver
from models.observer.module.module_errors import CellSpread
from models.observer.module.module_observer import ModuleObserver
from models.observer.observation import observer_of
from models.observer.tuning.tuning import with_tuned_observer


def with_tuned_module(model: ModuleNetwork, runs: list[TimeSeries], initial_soc: list[float]) -> ModuleNetwork:
    """Return the model with tuned settings in its cell's record; a cell from tests of cells has its own already."""
    if not model.record.own_cell:
        return model
    as_cells = [model.mean_cell_series(run) for run in runs]
    return replace(model, network=with_tuned_observer(model.network, as_cells, initial_soc))


def module_observer(model: ModuleNetwork, gain: str | None = None, spread: CellSpread | None = None) -> ModuleObserver:
    """Observer of a module.

    Parameters
    ----------
    model : of the module
    gain : see `observation.observer_of`
    spread : how different the cells are; None: what tuning with the module's own runs has found holds it already, and
        for a cell from tests of cells what is usual
    """
    cell: FuzzyObserver = observer_of(model.network, gain)
    return ModuleObserver(cell, model.module, spread or (None if model.record.own_cell else CellSpread()))
