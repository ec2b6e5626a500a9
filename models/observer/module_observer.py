"""The observer of a cell on a module of such cells, with each of the module models S1 to S4."""

from __future__ import annotations

import numpy as np

from models.module import ModuleModel
from models.observer import compiled
from models.observer.fuzzy_observer import FuzzyObserver, ObserverOutput, ObserverState
from models.timeseries import FloatArray

# Columns that a module has n times of, and p times of.
_VOLTS = [compiled.VOLTAGE_OUT, compiled.INNOVATION_OUT, compiled.INNOVATION_STD_OUT]
_AMPERES = [compiled.OFFSET_OUT, compiled.OFFSET_STD_OUT, compiled.CAPACITY_OUT, compiled.CAPACITY_STD_OUT]


class ModuleObserver:
    """Estimates the state of charge of a module's mean cell.

    The module's resistance and offset (eq. 2.27 to 2.30) are taken off its voltage, what is left is shared among the
    cells; a cell that differs from the mean is not seen.

    Parameters
    ----------
    cell : observer of one cell
    module : S1 to S4 with the layout
    """

    def __init__(self, cell: FuzzyObserver, module: ModuleModel) -> None:
        self.cell, self.module = cell, module
        self.dt_s = cell.dt_s

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
        rows[:, compiled.VOLTAGE_OUT] += beside_V
        rows[:, _AMPERES] *= parallel
        return state, rows

    def beside_cells_V(self, current_A: FloatArray) -> FloatArray:
        """(n,) voltage over what is not a cell; with an unknown current the offset of rest."""
        known = np.nan_to_num(np.asarray(current_A, dtype=np.float64))
        return self.module.voltage_V(np.zeros(len(known)), known)
