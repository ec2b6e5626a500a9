from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.network.free_run import free_run_V
from models.network.signals import KELVIN
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.readouts.ocv import OcvTable, ocv_table
from models.readouts.resistance import ResistanceTable, resistance_table
from models.thermal.closed_loop import simulate_closed
from models.thermal.model import ThermalModel, losses_W, polarisation_W_per_Ohm
from tests.unit.models import hand_network

THERMAL = ThermalModel(
    20.0,
    0.06,
    8.0,
    0.4,
    dU_dT_V_per_K=(-3e-4, 2e-4),
    dU_dT_soc=(0.3, 0.7),
    polarisation_Ohm=0.004,
    polarisation_s=200.0,
)
AXES = {"soc": [0.1, 0.5, 0.9], "temperature_degC": [5.0, 20.0, 40.0]}


def load_A(n: int = 3000) -> np.ndarray:
    rng = np.random.default_rng(3)
    return np.where(rng.random(n // 50) < 0.3, 0.0, rng.uniform(-7.0, 5.0, n // 50)).repeat(50)


@pytest.mark.parametrize("kernel", ["gaussian", "triangular", "uniform"])
@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("source", ["resistance", "overpotential"])
def test_voltage_is_the_free_run_at_the_temperature_that_comes_out(order: int, kernel: str, source: str) -> None:
    network = hand_network.everything(order, kernel)
    losses = resistance_table(network, **AXES) if source == "resistance" else ocv_table(network, **AXES)
    current = load_A()
    ambient = 15.0 + 5.0 * np.sin(np.arange(len(current)) / 500.0)
    result = simulate_closed(network, THERMAL, losses, current, ambient, initial_soc=0.55)
    assert np.ptp(result.temperature_degC) > 3.0
    run = hand_network.grid_run(current, result.temperature_degC)
    np.testing.assert_allclose(result.voltage_V, free_run_V(network, run, 0.55), rtol=0, atol=1e-10)


@pytest.mark.parametrize("axis", ["soc", "surface_soc:0.05/400/3500", "surface_soc:0.05/400/3500/30"])
def test_hats_run_in_closed_loop(axis: str) -> None:
    network, current = hand_network.hats(axis), load_A()
    result = simulate_closed(network, THERMAL, ocv_table(network, **AXES), current, 18.0, initial_soc=0.55)
    run = hand_network.grid_run(current, result.temperature_degC)
    np.testing.assert_allclose(result.voltage_V, free_run_V(network, run, 0.55), rtol=0, atol=1e-10)


def test_a_measured_first_voltage_starts_the_free_run() -> None:
    network = hand_network.everything(2)
    current = load_A(500)
    result = simulate_closed(
        network, THERMAL, ocv_table(network, **AXES), current, 15.0, initial_soc=0.55, initial_voltage_V=3.5
    )
    run = hand_network.grid_run(current, result.temperature_degC)
    run.voltage_V[0] = 3.5
    np.testing.assert_allclose(result.voltage_V, free_run_V(network, run, 0.55), rtol=0, atol=1e-10)
    assert result.voltage_V[0] == pytest.approx(3.5, abs=1e-12)


def test_temperature_is_the_heat_balance_of_the_heat_that_comes_out() -> None:
    network = hand_network.everything(1)
    table = resistance_table(network, **AXES)
    current = load_A()
    result = simulate_closed(network, THERMAL, table, current, 18.0, initial_soc=0.55, initial_degC=25.0)
    nodes = THERMAL.simulate(result.heat_W, np.full(len(current), 18.0), 1.0, 25.0)
    np.testing.assert_allclose(result.temperature_degC, nodes[:, 1], atol=1e-10)
    np.testing.assert_allclose(result.core_degC, nodes[:, 0], atol=1e-10)
    before = np.concatenate([[25.0], result.temperature_degC[:-1]])
    expected = current**2 * table.at(result.soc, current, before)
    expected += 0.004 * polarisation_W_per_Ohm(current, 200.0, 1.0, table)
    core = np.concatenate([[25.0], result.core_degC[:-1]])
    expected += current * THERMAL.entropic_V_per_K(result.soc) * (core + KELVIN)
    np.testing.assert_allclose(result.heat_W[1:], expected[1:], atol=1e-10)


def test_overpotential_gives_the_heat_of_its_own_record() -> None:
    """Heat from the simulated voltage, counted afterwards, is the heat that warmed the cell."""
    network = hand_network.everything(1)
    table = ocv_table(network, **AXES)
    current = load_A()
    model = ThermalModel(25.0, 0.06, polarisation_Ohm=0.004, polarisation_s=200.0)
    result = simulate_closed(network, model, table, current, 18.0, initial_soc=0.55)
    run = replace(hand_network.grid_run(current, result.temperature_degC), voltage_V=result.voltage_V)
    counted = losses_W(run, result.soc, table) + 0.004 * polarisation_W_per_Ohm(current, 200.0, 1.0, table)
    np.testing.assert_allclose(result.heat_W[1:], counted[1:], atol=0.02 * np.abs(counted).max())
    assert result.heat_W[1:].mean() == pytest.approx(counted[1:].mean(), rel=1e-3)


def test_a_steady_load_warms_to_where_losses_and_transfer_meet() -> None:
    """Closed form: dT = I^2 R(T) / h with R falling in a straight line between two temperatures."""
    structure = Structure(0, (InputChannel("current"),), (PartitionAxis("soc"),), hand_network.DT_S)
    network = hand_network.network(structure, np.array([[0.03, 3.6]]))
    table = ResistanceTable(
        np.array([-1.0, 1.0]),
        np.array([20.0, 60.0]),
        np.array([0.0, 1.0]),
        np.tile([[0.04, 0.04], [0.02, 0.02]], (2, 1, 1)),
    )
    current = np.tile([5.0, -5.0], 20_000)
    result = simulate_closed(network, ThermalModel(30.0, 0.05), table, current, 20.0, initial_soc=0.5)
    rise = 25.0 * 0.04 / (0.05 + 25.0 * 0.02 / 40.0)
    assert result.temperature_degC[-1] - 20.0 == pytest.approx(rise, rel=1e-6)
    assert result.soc[-1] == pytest.approx(0.5, abs=1e-3)


def test_samples_outside_the_trained_domain_are_marked() -> None:
    network = hand_network.everything(1)
    current = np.array([0.0, -4.0, -9.0, 2.0])
    result = simulate_closed(network, THERMAL, ocv_table(network, **AXES), current, 20.0, initial_soc=0.5)
    assert result.inside.tolist() == [True, True, False, True]
    hot = simulate_closed(network, THERMAL, ocv_table(network, **AXES), current, 60.0, initial_soc=0.5)
    assert not hot.inside.any()


def test_what_cannot_be_simulated_is_refused() -> None:
    network = hand_network.everything(1)
    table = ocv_table(network, **AXES)
    with pytest.raises(ModelError, match="finite"):
        simulate_closed(network, THERMAL, table, [0.0, np.nan], 20.0, initial_soc=0.5)
    with pytest.raises(ModelError, match="finite"):
        simulate_closed(network, THERMAL, table, [0.0, 1.0], 20.0, initial_soc=np.nan)
    voltage = table.voltage_V.copy()
    voltage[0, 0, 0] = np.nan
    unsettled = OcvTable(table.soc, table.temperature_degC, voltage)
    with pytest.raises(ModelError, match="1 points at which"):
        simulate_closed(network, THERMAL, unsettled, [0.0, 1.0], 20.0, initial_soc=0.5)
