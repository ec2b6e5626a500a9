"""The closed form of what a cell settles to against the cell itself, played in time."""

from dataclasses import replace

import pytest

from simulators.catalogue import CELLS
from simulators.cell import Cell
from simulators.settled import open_circuit_V, settled_resistance_Ohm, step_resistance_Ohm

# So large a cell keeps its state of charge and its temperature while everything else settles.
LARGE = 1e9
HOUR_S = 3600.0


def held(name: str, degC: float) -> Cell:
    p = CELLS[name].parameters
    p = replace(p, capacity_Ah=LARGE, heat_capacity_J_per_K=LARGE, heat_transfer_W_per_K=LARGE, hysteresis_rate=LARGE)
    return Cell(replace(p, charge_resistance_ratio=1.3, series_resistance_Ohm=0.004), 0.37, degC)


@pytest.mark.parametrize("current_A", [-3.0, 1.5])
@pytest.mark.parametrize("name", sorted(CELLS))
def test_the_cell_settles_where_the_closed_form_says(name: str, current_A: float) -> None:
    cell = held(name, 8.0)
    # Turns the hysteresis to the current's side before anything is looked at, then lets the cell rest.
    cell.step(current_A, 10.0)
    for _ in range(6):
        rested = cell.step(0.0, HOUR_S)
    side = 1.0 if current_A > 0.0 else -1.0
    p = cell.parameters
    assert rested.voltage_V == pytest.approx(float(open_circuit_V(p, 0.37, 8.0, side * cell.state.hysteresis * side)))
    after_60_s = cell.step(current_A, 60.0)
    expected = float(step_resistance_Ohm(p, 0.37, current_A, 8.0, 60.0))
    turned = p.hysteresis_amplitude_V * (cell.state.hysteresis - rested.hysteresis_V / p.hysteresis_amplitude_V)
    assert (after_60_s.voltage_V - rested.voltage_V - turned) / current_A == pytest.approx(expected, rel=1e-6)
    for _ in range(6):
        loaded = cell.step(current_A, HOUR_S)
    turned = loaded.hysteresis_V - rested.hysteresis_V
    found = (loaded.voltage_V - rested.voltage_V - turned) / current_A
    assert found == pytest.approx(float(settled_resistance_Ohm(p, 0.37, current_A, 8.0)), rel=1e-5)
