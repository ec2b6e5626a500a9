"""A simulated module: groups of parallel cells in series, each cell with properties of its own.

The cells of a group share their current so that their terminal voltages are equal at the end of each step:
V_j(i_j) = V for all j with sum i_j = I. V_j is linearised around the present guess, V_j + R_j di_j, for which

    V = (I - sum_j i_j + sum_j V_j / R_j) / (sum_j 1 / R_j),   di_j = (V - V_j) / R_j

solves the bordered linear system exactly; repeated, with R_j from the last two guesses, until the voltages agree.
Unequal cells thus exchange charge at rest, as they do in a real module. Balancing is passive and left out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from simulators.cell import (
    MAX_SUBSTEP_S,
    Branch,
    CellOutput,
    CellParameters,
    CellState,
    advance,
    initial_state,
    observe,
)

__all__ = ["Module", "ModuleLayout", "spread_cells"]

EQUAL_V = 1e-8  # far below any sensor's step
LEAST_MOVE_A = 1e-9
ROUNDS = 30
SLOPE_C_RATE = 1e-3  # the current, in capacities per hour, over which a slope is taken
LEAST_SOC, MOST_SOC = 0.0, 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleLayout:
    """How a module is built and how unequal its cells are.

    Attributes
    ----------
    cells_in_series, cells_in_parallel : int
    connector_resistance_Ohm : float
        From one parallel group to the next, terminals included: a module has as many as groups.
    capacity_spread, resistance_spread : float
        Relative standard deviation over the module's cells.
    soc_spread : float
        Standard deviation of the state of charge at the start.
    seed : int
        Of all draws.
    """

    cells_in_series: int = 1
    cells_in_parallel: int = 1
    connector_resistance_Ohm: float = 0.0
    capacity_spread: float = 0.0
    resistance_spread: float = 0.0
    soc_spread: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the layout once.

        Raises
        ------
        ValueError
            If there is no cell, or a resistance or a spread is negative, not finite or 25 % and more.
        """
        if self.cells_in_series < 1 or self.cells_in_parallel < 1:
            raise ValueError(f"module of {self.cells_in_series} x {self.cells_in_parallel} cells; at least 1 x 1")
        if not 0.0 <= self.connector_resistance_Ohm < math.inf:
            raise ValueError(f"connector_resistance_Ohm is {self.connector_resistance_Ohm}; it must be 0 or above")
        for name in ("capacity_spread", "resistance_spread", "soc_spread"):
            if not 0.0 <= getattr(self, name) < 0.25:
                raise ValueError(f"{name} is {getattr(self, name)}; it must lie in 0..0.25")

    @property
    def connectors_Ohm(self) -> float:
        """Resistance of all connectors together: what the module has beyond its cells."""
        return self.cells_in_series * self.connector_resistance_Ohm


def spread_cells(
    parameters: CellParameters, soc: float, layout: ModuleLayout
) -> tuple[list[list[CellParameters]], list[list[float]]]:
    """Draw the cells of a module.

    The mean over the module is that of the cell type: a module of cells that are all weaker than the one on the cell
    bench is another matter than spread.

    Parameters
    ----------
    parameters : CellParameters
        The cell type.
    soc : float
        Mean state of charge at the start.
    layout : ModuleLayout

    Returns
    -------
    parameters and states of charge, one list per parallel group
    """
    rng = np.random.default_rng(layout.seed)
    shape = (layout.cells_in_series, layout.cells_in_parallel)
    capacity, resistance, offset = (_centred(rng, shape) for _ in range(3))
    cells, socs = [], []
    for s in range(shape[0]):
        cells.append(
            [
                _scaled(
                    parameters,
                    float(1.0 + layout.capacity_spread * capacity[s, p]),
                    float(1.0 + layout.resistance_spread * resistance[s, p]),
                )
                for p in range(shape[1])
            ]
        )
        starts = np.clip(soc + layout.soc_spread * offset[s], LEAST_SOC, MOST_SOC)
        socs.append([float(value) for value in starts])
    return cells, socs


def _centred(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Draw numbers of mean 0 and standard deviation 1 (0 for a single cell), without far outliers."""
    draws = np.clip(rng.standard_normal(shape), -2.5, 2.5)
    draws -= draws.mean()
    size = float(draws.std())
    return draws / size if size > 0.0 else draws


def _scaled(p: CellParameters, capacity: float, resistance: float) -> CellParameters:
    branches = {
        name: Branch(branch.resistance_Ohm * resistance, branch.time_constant_s)
        for name, branch in (("fast_1", p.fast_1), ("fast_2", p.fast_2), ("slow", p.slow))
    }
    return replace(
        p,
        capacity_Ah=p.capacity_Ah * capacity,
        ohmic_Ohm=p.ohmic_Ohm * resistance,
        ohmic_at_empty_Ohm=p.ohmic_at_empty_Ohm * resistance,
        exchange_current_A=p.exchange_current_A / resistance,
        **branches,
    )


class _Group:
    """Cells in parallel: one voltage, shared current."""

    def __init__(self, cells: Sequence[CellParameters], socs: Sequence[float], ambient_degC: float) -> None:
        self.cells = list(cells)
        self.states: list[CellState] = [initial_state(soc, ambient_degC) for soc in socs]
        self.currents_A = [0.0] * len(self.cells)
        self._slopes_Ohm: list[float] = []

    def step(self, current_A: float, ambient_degC: float, dt_s: float) -> list[CellOutput]:
        """Move all cells by one sub-step and return what they show at its end; 0 s only looks.

        Raises
        ------
        ArithmeticError
            If no common voltage is found.
        """
        if len(self.cells) == 1:
            self.currents_A = [current_A]
            self.states, outputs = self._tried(self.currents_A, ambient_degC, dt_s)
            return outputs
        slopes = self._slopes_Ohm or self._measured_slopes_Ohm(ambient_degC, dt_s)
        shared = _moved(self.currents_A, [0.0] * len(self.cells), slopes, current_A)
        voltages: list[float] = []
        last = shared
        for _ in range(ROUNDS):
            states, outputs = self._tried(shared, ambient_degC, dt_s)
            before, voltages = voltages, [out.voltage_V for out in outputs]
            if max(voltages) - min(voltages) <= EQUAL_V:
                self.states, self.currents_A, self._slopes_Ohm = states, shared, slopes
                return outputs
            if before:
                changes = zip(slopes, voltages, before, shared, last, strict=True)
                slopes = [_secant_Ohm(*change) for change in changes]
            last, shared = shared, _moved(shared, voltages, slopes, current_A)
        raise ArithmeticError(f"parallel cells found no common voltage at {current_A} A: {voltages} V")

    def _tried(
        self, currents_A: Sequence[float], ambient_degC: float, dt_s: float
    ) -> tuple[list[CellState], list[CellOutput]]:
        triples = list(zip(self.cells, self.states, currents_A, strict=True))
        states = [advance(cell, state, i, ambient_degC, dt_s) for cell, state, i in triples]
        return states, [observe(cell, state, i) for (cell, _, i), state in zip(triples, states, strict=True)]

    def _measured_slopes_Ohm(self, ambient_degC: float, dt_s: float) -> list[float]:
        moves = [SLOPE_C_RATE * cell.capacity_Ah for cell in self.cells]
        _, rested = self._tried([0.0] * len(self.cells), ambient_degC, dt_s)
        _, loaded = self._tried(moves, ambient_degC, dt_s)
        differences = [b.voltage_V - a.voltage_V for a, b in zip(rested, loaded, strict=True)]
        slopes = [difference / move for difference, move in zip(differences, moves, strict=True)]
        if min(slopes) <= 0.0:
            raise ArithmeticError("parallel cells need a resistance to share a current; one has none")
        return slopes


def _moved(
    currents_A: Sequence[float], voltages: Sequence[float], slopes_Ohm: Sequence[float], total_A: float
) -> list[float]:
    """Currents of the given sum at which the linearised cells have one voltage."""
    conductance = sum(1.0 / slope for slope in slopes_Ohm)
    driven = sum(v / slope for v, slope in zip(voltages, slopes_Ohm, strict=True))
    common_V = (total_A - sum(currents_A) + driven) / conductance
    return [i + (common_V - v) / slope for i, v, slope in zip(currents_A, voltages, slopes_Ohm, strict=True)]


def _secant_Ohm(slope_Ohm: float, voltage_V: float, before_V: float, current_A: float, before_A: float) -> float:
    """Slope between the last two guesses; the old one where they lie too close to tell."""
    move = current_A - before_A
    found = (voltage_V - before_V) / move if abs(move) > LEAST_MOVE_A else slope_Ohm
    return found if found > 0.0 else slope_Ohm


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
        self._groups = [_Group(c, s, ambient_degC) for c, s in zip(cells, socs, strict=True)]

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

    def _step_group(self, group: _Group, current_A: float, dt_s: float, count: int) -> list[CellOutput]:
        outputs = group.step(current_A, self.ambient_degC, dt_s / count)
        for _ in range(count - 1):
            outputs = group.step(current_A, self.ambient_degC, dt_s / count)
        return outputs


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
