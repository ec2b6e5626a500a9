"""A simulated device that holds a voltage itself."""

from __future__ import annotations

import pytest

from simulators.catalogue import CELLS
from simulators.cell import Cell
from simulators.held_voltage import held_current_A
from tests.unit.simulators.test_cycler import running


@pytest.mark.parametrize(("hold_V", "set_A"), [(3.75, 2.0), (3.69, -2.0)])
def test_the_current_is_the_one_of_that_voltage(hold_V: float, set_A: float) -> None:
    cell = Cell(CELLS["nmc"].parameters, 0.5)
    before = cell.state
    held_A = held_current_A(cell, hold_V, set_A)
    assert 0.0 < held_A / set_A < 1.0 and cell.state == before
    assert cell.step(held_A, 0.0).voltage_V == pytest.approx(hold_V, abs=1e-5)
    assert held_current_A(cell, hold_V + set_A, set_A) == set_A, "far away: the whole current"
    assert held_current_A(cell, hold_V - set_A, set_A) == 0.0, "beyond: none, and never the opposite"


@pytest.mark.parametrize("dt_s", [0.1, 10.0])
def test_a_charge_goes_over_into_a_held_voltage(dt_s: float) -> None:
    device = running(5.0, watchdog=False, soc=0.85)
    device.hold_V = 4.18
    seen = []
    for _ in range(int(300 / dt_s)):
        device.advance(dt_s)
        seen.append((device.measurement.voltage_V, device.measurement.current_A))
    assert max(v for v, _ in seen) < 4.18 + 0.006, "noise of 1 mV and no more"
    assert seen[0][1] < 5.01 and seen[0][1] > 3.0 and 0.0 < seen[-1][1] < 2.5
    assert device.status == {"output_on", "remote", "voltage_held"}
    moved_Ah = sum(current_A for _, current_A in seen) * dt_s / 3600.0
    cell = device._cell
    assert isinstance(cell, Cell) and moved_Ah / 2.5 == pytest.approx(cell.state.soc - 0.85, abs=1e-5)
    device.restart()
    assert device.hold_V is None
