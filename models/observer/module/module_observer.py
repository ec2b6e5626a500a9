"""The observer of a cell on a module of such cells, with each of the module models S1 to S4."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray, TimeSeries
from models.module.models import ModuleModel
from models.observer.filter import places
from models.observer.filter.fuzzy_observer import FuzzyObserver, ObserverOutput, ObserverState
from models.observer.module.module_errors import CellSpread, module_settings, slow_error_V

# Columns that a module has n times of, and p times of.
_VOLTS = [places.VOLTAGE_OUT, places.INNOVATION_OUT, places.INNOVATION_STD_OUT]
_AMPERES = [places.OFFSET_OUT, places.OFFSET_STD_OUT, places.CAPACITY_OUT, places.CAPACITY_STD_OUT]
_USUAL = CellSpread()


class ModuleObserver:
    """Estimates the state of charge of a module's mean cell.

    The module's resistance and offset (eq. 2.27 to 2.30) are taken off its voltage, what is left is shared among the
    cells; a cell that differs from the mean is not seen. What the cells' spread and unknown resistances may make of the
    mean cell is in the band (`module_errors`).

    Parameters
    ----------
    cell : observer of one cell, tuned with data of cells
    module : S1 to S4 with the layout
    spread : how different the cells are; None where the cell's settings hold all of that already, tuned with the runs
        of modules that `mean_cell_run` gives
    """

    def __init__(self, cell: FuzzyObserver, module: ModuleModel, spread: CellSpread | None = _USUAL) -> None:
        network = cell.network
        if spread is not None:
            settings = module_settings(cell.settings, network, module, spread)
            cell = FuzzyObserver(network, settings, np.hypot(cell.more_slow_V, slow_error_V(network, module, spread)))
        self.cell, self.module = cell, module
        self.network, self.dt_s = cell.network, cell.dt_s

    def initial(self, soc: float, soc_std: float | None = None, temperature_degC: float = 25.0) -> ObserverState:
        """State before the first sample; see `FuzzyObserver.initial`."""
        return self.cell.initial(soc, soc_std, temperature_degC)

    def step(
        self, state: ObserverState, current_A: float, voltage_V: float, temperature_degC: float
    ) -> tuple[ObserverState, ObserverOutput]:
        """One sample of the module; see `FuzzyObserver.step`."""
        state, rows = self.replay(state, np.array([current_A]), np.array([voltage_V]), np.array([temperature_degC]))
        return state, ObserverOutput(*rows[0].tolist())

    def replay(
        self, state: ObserverState, current_A: FloatArray, voltage_V: FloatArray, temperature_degC: FloatArray
    ) -> tuple[ObserverState, FloatArray]:
        """Run over whole arrays of the module; voltages, currents and capacity of the answer are the module's."""
        in_series, parallel = self.module.cells_in_series, self.module.cells_in_parallel
        beside_V = self.beside_cells_V(current_A)
        cell_V = (voltage_V - beside_V) / in_series
        state, rows = self.cell.replay(state, self.module.cell_current_A(current_A), cell_V, temperature_degC)
        rows[:, _VOLTS] *= in_series
        rows[:, places.VOLTAGE_OUT] += beside_V
        rows[:, _AMPERES] *= parallel
        return state, rows

    def told_sensors(self, row: FloatArray) -> dict[str, dict[str, float] | None]:
        """Offset of the module's current sensor and its capacity, where the data tell; see `FuzzyObserver`."""
        of_cell = row.copy()
        of_cell[_AMPERES] /= self.module.cells_in_parallel
        told = self.cell.told_sensors(of_cell)
        parallel = self.module.cells_in_parallel
        return {name: each and {key: parallel * value for key, value in each.items()} for name, each in told.items()}

    def mean_cell_run(self, run: TimeSeries) -> TimeSeries:
        """Return a module's run as its mean cell sees it, for `tuning.tune`."""
        cell_V = (run.voltage_V - self.beside_cells_V(run.current_A)) / self.module.cells_in_series
        return replace(run, current_A=self.module.cell_current_A(run.current_A), voltage_V=cell_V)

    def mean_cell_grid(self, run: GridRun) -> GridRun:
        """Return a module's run on the grid with the current of its mean cell, for `smoothing.smoothed_soc`."""
        return replace(run, current_A=self.module.cell_current_A(run.current_A))

    def beside_cells_V(self, current_A: FloatArray) -> FloatArray:
        """(n,) voltage over what is not a cell; with an unknown current the offset of rest."""
        known = np.nan_to_num(np.asarray(current_A, dtype=np.float64))
        return self.module.voltage_V(np.zeros(len(known)), known)
