"""An identified network that is stepped as a battery is the network's own free run."""

import numpy as np
import pytest

from bench_service.cli.network_cell import ModuleOfCells, NetworkCell
from models.module.models import ModuleModel
from models.network.free_run import free_run_V
from models.readouts.ocv import ocv_table
from models.thermal.closed_loop import simulate_closed
from models.thermal.model import ThermalModel
from tests.unit.models import hand_network


def load_A(n: int = 400) -> np.ndarray:
    rng = np.random.default_rng(7)
    current = np.where(rng.random(n // 20) < 0.3, 0.0, rng.uniform(-6.0, 4.0, n // 20)).repeat(20)
    current[0] = 0.0
    return current


@pytest.mark.parametrize("order", [0, 1, 2])
def test_on_the_grid_it_is_the_free_run(order: int) -> None:
    network = hand_network.everything(order)
    current = load_A()
    cell = NetworkCell(network, 0.55, 22.0)
    seen = [cell.step(0.0, 0.0).voltage_V] + [cell.step(value, hand_network.DT_S).voltage_V for value in current[1:]]
    expected = free_run_V(network, hand_network.grid_run(current, 22.0), 0.55)
    # Where past outputs are used, the free run holds its first value for that many samples; the cell is settled there.
    np.testing.assert_allclose(seen[20:], expected[20:], rtol=0, atol=1e-9 if order == 0 else 2e-3)


def test_small_steps_lose_no_charge_and_end_on_the_grid() -> None:
    network = hand_network.everything(2)
    coarse, fine = NetworkCell(network, 0.55, 22.0), NetworkCell(network, 0.55, 22.0)
    for current_A in load_A(200):
        one = coarse.step(current_A, 1.0)
        for _ in range(100):
            many = fine.step(current_A, 0.01)
    assert many.voltage_V == pytest.approx(one.voltage_V, abs=1e-9)
    assert many.soc == pytest.approx(one.soc, abs=1e-12)


def test_between_two_samples_the_step_of_the_current_is_there_at_once() -> None:
    cell = NetworkCell(hand_network.everything(1), 0.55, 22.0)
    for _ in range(50):
        rest = cell.step(0.0, 1.0)
    pulse = cell.step(4.0, 0.01)
    assert pulse.voltage_V > rest.voltage_V + 1e-3
    assert cell.step(4.0, 0.0).voltage_V == pulse.voltage_V, "looking moves nothing"


@pytest.mark.proof
def test_with_a_heat_balance_it_is_the_closed_simulation() -> None:
    thermal = ThermalModel(
        20.0, 0.06, 8.0, 0.4, dU_dT_V_per_K=(-3e-4, 2e-4), dU_dT_soc=(0.3, 0.7), polarisation_Ohm=0.004,
        polarisation_s=200.0,
    )  # fmt: skip
    network, current = hand_network.everything(1), 1.2 * load_A(1200)
    ocv = ocv_table(network, soc=[0.1, 0.5, 0.9], temperature_degC=[5.0, 20.0, 40.0])
    expected = simulate_closed(network, thermal, ocv, current, 22.0, initial_soc=0.55)
    cell = NetworkCell(network, 0.55, 22.0, (thermal, ocv))
    seen = [cell.step(0.0, 0.0)] + [cell.step(value, 1.0) for value in current[1:]]
    assert np.ptp(expected.temperature_degC) > 1.0
    assert [out.temperature_degC for out in seen] == pytest.approx(expected.temperature_degC, abs=1e-6)
    assert [out.voltage_V for out in seen] == pytest.approx(expected.voltage_V, abs=1e-6)


def test_a_module_of_such_cells() -> None:
    model = ModuleModel("S3", 4, 2, (0.01, 0.01), (0.05, 0.05))
    alone, inside = (NetworkCell(hand_network.everything(1), 0.55, 22.0) for _ in range(2))
    module = ModuleOfCells(inside, model)
    for current_A in (2.0, -3.0):
        one, whole = alone.step(current_A, 1.0), module.step(2 * current_A, 1.0)
        assert whole.voltage_V == pytest.approx(4 * one.voltage_V + 0.01 * 2 * current_A + 0.05)
        assert whole.soc == one.soc
