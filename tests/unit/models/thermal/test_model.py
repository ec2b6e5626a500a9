import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from models.data.errors import ModelError
from models.network.signals import KELVIN
from models.readouts.ocv import OcvTable
from models.readouts.resistance import ResistanceTable
from models.thermal.model import ThermalModel, losses_W, polarisation_W_per_Ohm
from tests.unit.models import hand_network

ONE = ThermalModel(45.0, 0.1)
TWO = ThermalModel(30.0, 0.12, surface_heat_capacity_J_per_K=15.0, core_to_surface_W_per_K=0.9)


@pytest.mark.parametrize("dt_s", [0.1, 1.0, 3600.0])
def test_one_node_follows_the_exponential_at_any_step(dt_s: float) -> None:
    n = 12
    found = ONE.simulate(np.full(n, 2.0), np.full(n, 20.0), dt_s, 5.0)
    expected = 40.0 - 35.0 * np.exp(-0.1 / 45.0 * dt_s * np.arange(n))
    np.testing.assert_allclose(found[:, 0], expected, rtol=0, atol=1e-11)


def test_without_transfer_all_heat_stays() -> None:
    found = ThermalModel(45.0, 0.0).simulate(np.full(11, 4.5), np.full(11, -10.0), 2.0, 20.0)
    assert found[-1, 0] == pytest.approx(20.0 + 10 * 2.0 * 4.5 / 45.0, abs=1e-11)


@pytest.mark.parametrize("model", [ONE, TWO])
def test_steps_agree_with_an_ode_solver(model: ThermalModel) -> None:
    rng = np.random.default_rng(0)
    n, dt_s = 40, 25.0
    heat, ambient = rng.uniform(0.0, 3.0, n), rng.uniform(0.0, 30.0, n)
    found = model.simulate(heat, ambient, dt_s, 12.0)
    state = np.full(model.n_nodes, 12.0)
    for k in range(1, n):
        state = solve_ivp(_balance(model, heat[k], ambient[k]), (0.0, dt_s), state, rtol=1e-10, atol=1e-10).y[:, -1]
        np.testing.assert_allclose(found[k], state, atol=1e-6)


def _balance(model: ThermalModel, heat_W: float, ambient_degC: float):
    def slope(_: float, t: np.ndarray) -> list[float]:
        k, s = model.core_to_surface_W_per_K, model.surface_heat_capacity_J_per_K
        if k is None or s is None:
            return [(model.heat_transfer_W_per_K * (ambient_degC - t[0]) + heat_W) / model.heat_capacity_J_per_K]
        flow = k * (t[0] - t[1])
        lost = model.heat_transfer_W_per_K * (t[1] - ambient_degC)
        return [(heat_W - flow) / model.heat_capacity_J_per_K, (flow - lost) / s]

    return slope


def test_core_is_warmer_than_the_case_by_heat_over_transfer() -> None:
    core, case = TWO.simulate(np.full(200, 1.8), np.full(200, 25.0), 60.0, 25.0)[-1]
    assert core - case == pytest.approx(1.8 / 0.9, abs=1e-9)
    assert case - 25.0 == pytest.approx(1.8 / 0.12, abs=1e-6)


def test_reversible_heat_is_current_times_absolute_temperature() -> None:
    model = ThermalModel(45.0, 0.0, dU_dT_V_per_K=(-2e-4, 1e-4), dU_dT_soc=(0.2, 0.8))
    n, current, soc = 2, np.full(2, -3.0), np.array([0.5, 0.35])
    found = model.simulate(np.zeros(n), np.full(n, 25.0), 10.0, 25.0, current, soc)
    coefficient = -2e-4 + 3e-4 * (0.35 - 0.2) / 0.6
    assert found[1, 0] - 25.0 == pytest.approx(-3.0 * (25.0 + KELVIN) * coefficient * 10.0 / 45.0, rel=1e-12)


def test_heat_from_tables() -> None:
    table = ResistanceTable(
        np.array([-2.0, 2.0]), np.array([0.0, 40.0]), np.array([0.0, 1.0]), np.arange(8.0).reshape(2, 2, 2) / 100.0
    )
    run = hand_network.grid_run(np.array([-3.0, 4.0, 0.0]), np.array([20.0, 0.0, 10.0]))
    np.testing.assert_allclose(losses_W(run, np.array([0.5, 1.0, 0.3]), table), [9.0 * 0.015, 16.0 * 0.05, 0.0])
    ocv = OcvTable(np.array([0.0, 1.0]), np.array([25.0]), np.array([[[3.0, 4.0]], [[3.1, 4.1]]]))
    voltage = np.array([3.5, np.nan, 3.8])
    heat = losses_W(replace(run, voltage_V=voltage), np.full(3, 0.5), ocv)
    np.testing.assert_allclose(heat, [-3.0 * -0.05, 4.0 * 0.10, 0.0], atol=1e-12)
    with pytest.raises(ModelError, match="no voltage"):
        losses_W(run, np.full(3, 0.5), ocv)


@pytest.mark.parametrize("settled", [False, True])
def test_polarisation_releases_its_heat_late_but_all_of_it(settled: bool) -> None:
    """A resistance and a pair: the dissipation R_0 I^2 + R_p i_p^2 is what the table says plus what comes later."""
    current = np.repeat([0.0, 4.0, -2.0, 0.0], [10, 300, 200, 6000])
    through = np.zeros(len(current))
    for k in range(1, len(current)):
        through[k] = np.exp(-1.0 / 400.0) * through[k - 1] + (1.0 - np.exp(-1.0 / 400.0)) * current[k]
    true = 0.02 * current**2 + 0.01 * through**2
    soc, degC = np.array([0.0, 1.0]), np.array([25.0])
    table = (
        ResistanceTable(np.array([-1.0, 1.0]), degC, soc, np.full((2, 1, 2), 0.03))
        if settled
        else OcvTable(soc, degC, np.full((2, 1, 2), 3.6))
    )
    run = hand_network.grid_run(current, 25.0)
    run = replace(run, voltage_V=3.6 + 0.02 * current + 0.01 * through)
    counted = losses_W(run, np.full(len(current), 0.5), table)
    late = 0.01 * polarisation_W_per_Ohm(current, 400.0, 1.0, table)
    np.testing.assert_allclose(counted + late, true, atol=1e-12)
    if not settled:
        assert late.sum() == pytest.approx(0.0, abs=1e-2 * counted.sum())


def test_document_comes_back_the_same() -> None:
    for model in (
        ONE,
        ThermalModel(30.0, 0.1, 15.0, 0.9, (1e-4, 2e-4), (0.1, 0.9), 0.01, 300.0, {"dU_dT_V_per_K": 0.3}),
    ):
        assert ThermalModel.from_json(json.loads(json.dumps(model.to_json()))) == model
    with pytest.raises(ModelError, match="not a thermal model"):
        ThermalModel.from_json({"kind": "thermal_model", "schema_version": 7})
    with pytest.raises(ModelError, match="damaged"):
        ThermalModel.from_json(ONE.to_json() | {"colour": "red"})


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"heat_capacity_J_per_K": 0.0}, "positive"),
        ({"heat_transfer_W_per_K": -0.1}, "positive"),
        ({"core_to_surface_W_per_K": 1.0}, "both"),
        ({"polarisation_s": 0.0}, "positive"),
        ({"dU_dT_V_per_K": (0.0, 1.0)}, "one entropic coefficient"),
    ],
)
def test_impossible_models_are_refused(values: dict, says: str) -> None:
    with pytest.raises(ModelError, match=says):
        ThermalModel(**({"heat_capacity_J_per_K": 45.0, "heat_transfer_W_per_K": 0.1} | values))
