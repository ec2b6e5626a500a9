"""Cells in parallel: one voltage, shared current.

The cells of a group share their current so that their terminal voltages are equal at the end of each step:
V_j(i_j) = V for all j with sum i_j = I. V_j is linearised around the present guess, V_j + R_j di_j, for which

    V = (I - sum_j i_j + sum_j V_j / R_j) / (sum_j 1 / R_j),   di_j = (V - V_j) / R_j

solves the bordered linear system exactly; repeated, with R_j from the last two guesses, until the voltages agree.
Unequal cells thus exchange charge at rest, as they do in a real module. Balancing is passive and left out.
"""

from collections.abc import Sequence

from simulators.cell import CellOutput, CellState, advance, initial_state, observe
from simulators.cell_parameters import CellParameters

__all__ = ["ParallelCells"]

EQUAL_V = 1e-8  # far below any sensor's step
LEAST_MOVE_A = 1e-9
ROUNDS = 30
SLOPE_C_RATE = 1e-3  # the current, in capacities per hour, over which a slope is taken


class ParallelCells:
    """A group of cells with their states.

    Parameters
    ----------
    cells : sequence of CellParameters
    socs : sequence of float
        State of charge of each at the start, 0..1.
    ambient_degC : float
        Temperature of each at the start.
    """

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
