"""The module against single cells, Kirchhoff's laws and balances."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.bench import SimulatorSettings, build_device
from simulators.catalogue import CELLS
from simulators.cell import Cell, advance, initial_state, observe
from simulators.module import Module
from simulators.module_layout import ModuleLayout, spread_cells

NMC = CELLS["nmc"].parameters
UNEQUAL = {"capacity_spread": 0.04, "resistance_spread": 0.15, "soc_spread": 0.03}


def test_equal_cells_are_one_cell_times_their_numbers() -> None:
    module = Module(NMC, ModuleLayout(cells_in_series=4, cells_in_parallel=3, connector_resistance_Ohm=0.002), soc=0.6)
    cell = Cell(NMC, soc=0.6)
    for current_A, time_s in ((0.0, 0.0), (2.0, 1.0), (-4.0, 30.0), (0.0, 100.0), (3.0, 7.5)):
        whole, one = module.step(3 * current_A, time_s), cell.step(current_A, time_s)
        assert whole.voltage_V == pytest.approx(4 * one.voltage_V + 4 * 0.002 * 3 * current_A, abs=1e-9)
        assert whole.temperature_degC == pytest.approx(one.temperature_degC, abs=1e-9)
        assert whole.soc == pytest.approx(one.soc, abs=1e-12)
        assert whole.open_circuit_V == pytest.approx(4 * one.open_circuit_V, abs=1e-9)
        assert whole.heat_J == pytest.approx(12 * one.heat_J, rel=1e-9)


def test_series_cells_carry_the_whole_current_and_add_their_voltages() -> None:
    layout = ModuleLayout(cells_in_series=3, **UNEQUAL, seed=4)
    module = Module(NMC, layout, soc=0.5)
    cells, socs = spread_cells(NMC, 0.5, layout)
    states = [initial_state(group[0], 25.0) for group in socs]
    for current_A in (3.0, -5.0, 0.0):
        out = module.step(current_A, 1.0)
        states = [advance(cell[0], state, current_A, 25.0, 1.0) for cell, state in zip(cells, states, strict=True)]
        alone = [observe(cell[0], state, current_A).voltage_V for cell, state in zip(cells, states, strict=True)]
        assert out.voltage_V == pytest.approx(sum(alone), abs=1e-12)
        assert module.cell_currents_A == [[current_A]] * 3


@settings(max_examples=25, deadline=None)
@given(
    name=st.sampled_from(sorted(CELLS)),
    seed=st.integers(0, 1000),
    profile=st.lists(st.tuples(st.floats(-30, 30), st.sampled_from([0.0, 0.02, 1.0, 3.0])), min_size=1, max_size=12),
)
def test_parallel_cells_have_one_voltage_and_share_the_current(
    name: str, seed: int, profile: list[tuple[float, float]]
) -> None:
    parameters = CELLS[name].parameters
    layout = ModuleLayout(cells_in_series=2, cells_in_parallel=3, **UNEQUAL, seed=seed)
    module = Module(parameters, layout, soc=0.5)
    cells, _ = spread_cells(parameters, 0.5, layout)
    for current_A, time_s in profile:
        out = module.step(current_A, time_s)
        total_V = 0.0
        for group, parts, currents in zip(module.groups, cells, module.cell_currents_A, strict=True):
            assert sum(currents) == pytest.approx(current_A, abs=1e-9)
            voltages = [observe(p, s, i).voltage_V for p, s, i in zip(parts, group, currents, strict=True)]
            assert max(voltages) - min(voltages) < 2e-8
            total_V += voltages[0]
        assert out.voltage_V == pytest.approx(total_V, abs=1e-7)


def test_two_cells_share_by_their_conductance() -> None:
    """Closed form: at the first instant each takes the current in the ratio of the other's ohmic resistance."""
    plain = replace(NMC, charge_transfer_V=0.0, activation_K=0.0, ohmic_at_empty_Ohm=0.0)
    layout = ModuleLayout(cells_in_parallel=2, resistance_spread=0.2, seed=1)
    (pair,), _ = spread_cells(plain, 0.5, layout)
    module = Module(plain, layout, soc=0.5)
    module.step(6.0, 1e-9)
    ((a, b),) = module.cell_currents_A
    assert a / b == pytest.approx(pair[1].ohmic_Ohm / pair[0].ohmic_Ohm, rel=1e-6)
    assert a + b == pytest.approx(6.0)


def test_unequal_cells_balance_at_rest() -> None:
    layout = ModuleLayout(cells_in_parallel=2, soc_spread=0.05, seed=2)
    module = Module(NMC, layout, soc=0.5)
    ((high, low),) = module.cell_soc
    if high < low:
        high, low = low, high
    assert high - low == pytest.approx(0.1, abs=1e-9)
    module.step(0.0, 1.0)
    ((i_1, i_2),) = module.cell_currents_A
    assert i_1 == pytest.approx(-i_2) and abs(i_1) > 0.1
    for _ in range(60):
        module.step(0.0, 60.0)
    ((s_1, s_2),) = module.cell_soc
    assert abs(s_1 - s_2) < 0.02
    assert 0.5 * (s_1 + s_2) == pytest.approx(0.5, abs=1e-9)


def test_charge_is_kept() -> None:
    module = Module(NMC, ModuleLayout(cells_in_series=2, cells_in_parallel=2, **UNEQUAL, seed=3), soc=0.5)
    before = np.array(module.cell_soc) * np.array(module.cell_capacity_Ah)
    for current_A in (4.0, -6.0, 0.0):
        module.step(current_A, 90.0)
    moved_Ah = np.array(module.cell_soc) * np.array(module.cell_capacity_Ah) - before
    np.testing.assert_allclose(moved_Ah.sum(axis=1), -2.0 * 90.0 / 3600.0, atol=1e-10)


def test_spread_is_what_was_asked_for_around_the_type() -> None:
    layout = ModuleLayout(cells_in_series=6, cells_in_parallel=2, **UNEQUAL, seed=7)
    cells, socs = spread_cells(NMC, 0.5, layout)
    capacity = np.array([[cell.capacity_Ah for cell in group] for group in cells]) / NMC.capacity_Ah
    ohmic = np.array([[cell.ohmic_Ohm for cell in group] for group in cells]) / NMC.ohmic_Ohm
    slow = np.array([[cell.slow.resistance_Ohm for cell in group] for group in cells]) / NMC.slow.resistance_Ohm
    for values, size in ((capacity, 0.04), (ohmic, 0.15), (slow, 0.15)):
        assert values.mean() == pytest.approx(1.0, abs=1e-12)
        assert values.std() == pytest.approx(size, rel=1e-9)
    assert np.mean(socs) == pytest.approx(0.5, abs=1e-12)
    assert np.std(socs) == pytest.approx(0.03, rel=1e-9)
    np.testing.assert_allclose(ohmic, slow)


def test_seed_decides_all_draws() -> None:
    def voltages(seed: int) -> list[float]:
        module = Module(NMC, ModuleLayout(cells_in_series=2, cells_in_parallel=2, **UNEQUAL, seed=seed))
        return [module.step(current_A, 1.0).voltage_V for current_A in (3.0, -2.0, 0.0)]

    assert voltages(5) == voltages(5)
    assert voltages(5) != voltages(6)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"cells_in_series": 0}, "at least 1 x 1"),
        ({"connector_resistance_Ohm": -1.0}, "0 or above"),
        ({"connector_resistance_Ohm": math.nan}, "0 or above"),
        ({"soc_spread": 0.4}, "soc_spread"),
        ({"capacity_spread": math.nan}, "capacity_spread"),
    ],
)
def test_impossible_layouts_are_refused(changes: dict[str, float], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        ModuleLayout(**changes)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(("current_A", "dt_s"), [(math.nan, 1.0), (1.0, -1.0), (1.0, math.inf)])
def test_impossible_steps_are_refused(current_A: float, dt_s: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        Module(NMC, ModuleLayout()).step(current_A, dt_s)
    with pytest.raises(ValueError, match=r"0\.\.1"):
        Module(NMC, ModuleLayout(), soc=1.2)


def test_a_simulated_bench_takes_a_module() -> None:
    layout = ModuleLayout(cells_in_series=4, cells_in_parallel=2)
    device = build_device(SimulatorSettings(module=layout, initial_soc=0.5, lock_step=True))
    cell_V = NMC.open_circuit.voltage_V(0.5)
    assert device.cycler.measurement.voltage_V == pytest.approx(4 * cell_V, abs=0.01)
    assert device.cycler.settings.nominal_voltage_V == 24.0
    assert device.cycler.settings.nominal_current_A == 60.0
    assert not device.cycler.alarms
