"""A simulated module: groups of parallel cells in series, each cell with properties of its own."""

import math
from collections.abc import Sequence

from simulators.cell import MAX_SUBSTEP_S, CellOutput, CellState, initial_state
from simulators.cell_parameters import CellParameters
from simulators.module_layout import ModuleLayout, spread_cells
from simulators.parallel_cells import ParallelCells

__all__ = ["Module", "ModuleLayout"]


class Module:
    """A module with its state, in place of a cell behind a cycler.

    Parameters
    ----------
    parameters : CellParameters
        The cell type.
    layout : ModuleLayout
    soc : float
        Mean state of charge at the start, 0..1.
    ambient_degC : float
        Constant ambient temperature of all cells; they start at it.

    Raises
    ------
    ValueError
        If the state of charge lies outside 0..1.
    """

    def __init__(
        self, parameters: CellParameters, layout: ModuleLayout, soc: float = 0.5, ambient_degC: float = 25.0
    ) -> None:
        initial_state(soc, ambient_degC)  # checks both
        self.layout = layout
        self.ambient_degC = ambient_degC
        cells, socs = spread_cells(parameters, soc, layout)
        self._groups = [ParallelCells(c, s, ambient_degC) for c, s in zip(cells, socs, strict=True)]

    @property
    def groups(self) -> list[list[CellState]]:
        """State of each cell, one list per parallel group."""
        return [list(group.states) for group in self._groups]

    @property
    def cell_currents_A(self) -> list[list[float]]:
        """Current of each cell, one list per parallel group."""
        return [list(group.currents_A) for group in self._groups]

    @property
    def cell_soc(self) -> list[list[float]]:
        """State of charge of each cell, one list per parallel group."""
        return [[state.soc for state in group.states] for group in self._groups]

    @property
    def cell_capacity_Ah(self) -> list[list[float]]:
        """Capacity of each cell, one list per parallel group."""
        return [[cell.capacity_Ah for cell in group.cells] for group in self._groups]

    def step(self, current_A: float, dt_s: float) -> CellOutput:
        """Hold `current_A` (positive charges) through the module for `dt_s` and return the truth at its end.

        Returns
        -------
        CellOutput
            Voltages of the whole module; mean temperature and state of charge of its cells; heat of all of them,
            connectors left out.

        Raises
        ------
        ValueError
            If the current is not finite or the time negative or not finite.
        ArithmeticError
            If parallel cells find no common voltage.
        """
        if not (math.isfinite(current_A) and 0.0 <= dt_s < math.inf):
            raise ValueError(f"module step: current {current_A} A for {dt_s} s; finite values and time >= 0 are needed")
        count = max(1, math.ceil(dt_s / MAX_SUBSTEP_S))
        groups = [self._step_group(group, current_A, dt_s, count) for group in self._groups]
        cells = [out for group in groups for out in group]
        return CellOutput(
            voltage_V=sum(_mean([out.voltage_V for out in group]) for group in groups)
            + self.layout.connectors_Ohm * current_A,
            temperature_degC=_mean([out.temperature_degC for out in cells]),
            soc=_mean([out.soc for out in cells]),
            open_circuit_V=sum(_mean([out.open_circuit_V for out in group]) for group in groups),
            hysteresis_V=sum(_mean([out.hysteresis_V for out in group]) for group in groups),
            heat_J=sum(out.heat_J for out in cells),
        )

    def _step_group(self, group: ParallelCells, current_A: float, dt_s: float, count: int) -> list[CellOutput]:
        outputs = group.step(current_A, self.ambient_degC, dt_s / count)
        for _ in range(count - 1):
            outputs = group.step(current_A, self.ambient_degC, dt_s / count)
        return outputs


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
