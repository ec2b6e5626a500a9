from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError, NotIdentifiableError
from models.data.resampling import GridRun, to_grid
from models.readouts.ocv import OcvTable
from models.readouts.resistance import ResistanceTable
from models.thermal.identification import ThermalFit, identify_thermal
from models.thermal.model import ThermalModel, polarisation_W_per_Ohm
from models.thermal.problem import ThermalProblem
from simulators.catalogue import CELLS
from simulators.cell import Cell
from tests.unit.models import hand_network, simulated_cells

ONE = ThermalModel(48.0, 0.13, dU_dT_V_per_K=(-8e-5,), polarisation_Ohm=0.02, polarisation_s=500.0)
TWO = ThermalModel(32.0, 0.14, 14.0, 0.5, (-8e-5,))
OHM = 0.05
SOC, DEGC = np.array([0.0, 1.0]), np.array([25.0])
CONSTANT = OcvTable(SOC, DEGC, np.full((2, 1, 2), 3.6))


def made(
    model: ThermalModel, n: int = 4000, load_A: float = 6.0, noise_K: float = 0.0, seed: int = 0, rest: int = 1200
) -> GridRun:
    """Temperatures that a model itself makes from random loads through 50 mOhm and an ambient that drifts."""
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.uniform(-load_A, load_A, -(-n // 100)), 100)[:n]
    current[n - rest :] = 0.0
    late = polarisation_W_per_Ohm(current, model.polarisation_s, 1.0, CONSTANT)
    heat = OHM * current**2 + model.polarisation_Ohm * late
    ambient = 18.0 + 2.0 * np.sin(np.arange(n) / 900.0)
    nodes = model.simulate(heat, ambient, hand_network.DT_S, 19.0, current, np.full(n, 0.5))
    run = hand_network.grid_run(current, nodes[:, -1] + noise_K * rng.standard_normal(n), ambient)
    return replace(run, voltage_V=3.6 + OHM * current)


def fitted(runs: list[GridRun], **options) -> ThermalFit:
    return identify_thermal(runs, [np.full(len(run), 0.5) for run in runs], CONSTANT, **options)


@pytest.mark.parametrize("signed", [(), ("dU_dT_V_per_K", "polarisation_Ohm")])
@pytest.mark.parametrize("model", [ONE, TWO])
def test_sensitivities_match_finite_differences(model: ThermalModel, signed: tuple[str, ...]) -> None:
    names = ("heat_capacity_J_per_K", "heat_transfer_W_per_K")
    names += ("surface_heat_capacity_J_per_K", "core_to_surface_W_per_K") if model.n_nodes == 2 else ()
    names += signed
    runs, soc = [made(model, n=800, rest=100, seed=s, noise_K=0.1) for s in (0, 1)], [np.full(800, 0.5)] * 2
    problem = ThermalProblem(runs, soc, CONSTANT, names, model)
    x = problem.start()
    _, jacobian = problem.linearised(x)
    assert jacobian.shape == (1600, len(names) + 2)
    for j in range(len(x)):
        step = np.zeros(len(x))
        step[j] = 1e-7 if j < len(names) and names[j] == "dU_dT_V_per_K" else 1e-5
        numeric = -(problem.residual(x + step) - problem.residual(x - step)) / (2.0 * step[j])
        np.testing.assert_allclose(jacobian[:, j], numeric, atol=1e-6 * np.abs(numeric).max())


def test_one_node_is_found_again_exactly() -> None:
    fit = fitted([made(ONE)], reversible=True, polarisation_s=500.0)
    assert fit.model.heat_capacity_J_per_K == pytest.approx(48.0, rel=1e-6)
    assert fit.model.heat_transfer_W_per_K == pytest.approx(0.13, rel=1e-6)
    assert fit.model.dU_dT_V_per_K[0] == pytest.approx(-8e-5, rel=1e-6)
    assert fit.model.polarisation_Ohm == pytest.approx(0.02, rel=1e-5)
    assert fit.rmse_K < 1e-6
    assert fit.reservations == ()


def test_two_nodes_are_found_again_from_the_case_alone() -> None:
    runs = [made(TWO, n=6000, load_A=12.0, noise_K=0.005, seed=s) for s in (1, 2)]
    model = fitted(runs, surface=True, reversible=True, polarisation_s=None).model
    assert model.n_nodes == 2
    for name in ("heat_capacity_J_per_K", "heat_transfer_W_per_K", "core_to_surface_W_per_K"):
        assert getattr(model, name) == pytest.approx(getattr(TWO, name), rel=0.05)
        assert getattr(model, name) == pytest.approx(getattr(TWO, name), abs=4.0 * model.std[name])


def test_an_entropic_curve_is_kept() -> None:
    curve = replace(ONE, dU_dT_V_per_K=(-1e-4, 3e-4), dU_dT_soc=(0.4, 0.6))
    fit = fitted([made(curve)], start=curve, polarisation_s=500.0)
    assert fit.model.dU_dT_V_per_K == curve.dU_dT_V_per_K
    assert fit.model.heat_capacity_J_per_K == pytest.approx(48.0, rel=1e-6)


def overpotential_fit(name: str, seed: int, **options) -> ThermalFit:
    """A simulated cell's own record, with heat from its voltage above the open-circuit curve."""
    p = CELLS[name].parameters
    current = simulated_cells.pulses_A(9000, p.capacity_Ah, seed, rest=1500)
    run = to_grid(simulated_cells.record(Cell(p, 0.6, simulated_cells.AMBIENT_DEGC), current, seed), 1.0)
    assert run.soc_ref is not None
    return identify_thermal([run], [run.soc_ref], simulated_cells.true_ocv(name), reversible=True, **options)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("name", sorted(CELLS))
def test_parameters_of_a_simulated_cell(name: str, seed: int) -> None:
    p, fit = CELLS[name].parameters, overpotential_fit(name, seed)
    assert fit.model.heat_capacity_J_per_K == pytest.approx(p.heat_capacity_J_per_K, rel=0.03)
    assert fit.model.heat_transfer_W_per_K == pytest.approx(p.heat_transfer_W_per_K, rel=0.01)
    assert fit.model.dU_dT_V_per_K[0] == pytest.approx(p.dU_dT_V_per_K, rel=0.1)
    assert fit.rmse_K < 0.05


def test_heat_that_comes_later_is_taken_for_capacity_where_polarisation_is_left_out() -> None:
    truth = CELLS["nimh"].parameters.heat_capacity_J_per_K
    without, found = overpotential_fit("nimh", 0, polarisation_s=None), overpotential_fit("nimh", 0)
    assert without.model.heat_capacity_J_per_K > 1.03 * truth
    assert abs(found.model.heat_capacity_J_per_K - truth) < 0.5 * (without.model.heat_capacity_J_per_K - truth)
    assert found.rmse_K < 0.7 * without.rmse_K


def test_standard_deviations_hold_over_repeated_fits() -> None:
    """White sensor noise: the errors in units of the stated standard deviation have a spread of 1."""
    truth = {"heat_capacity_J_per_K": 48.0, "heat_transfer_W_per_K": 0.13, "polarisation_Ohm": 0.02}
    scores = []
    for seed in range(40):
        run = made(ONE, n=2000, noise_K=0.05, seed=seed, rest=600)
        model = fitted([run], reversible=True, polarisation_s=500.0).model
        scores.append([(getattr(model, name) - value) / model.std[name] for name, value in truth.items()])
    spread = np.sqrt(np.mean(np.square(scores), axis=0))
    assert (spread > 0.7).all() and (spread < 1.35).all()


def test_a_temperature_that_hardly_moves_is_refused() -> None:
    n = 3000
    temperature = 20.0 + 0.02 * np.random.default_rng(0).standard_normal(n)
    with pytest.raises(NotIdentifiableError, match=r"moves by 0\.\d+ K only"):
        fitted([hand_network.grid_run(np.full(n, 0.2), temperature, 20.0)])


@pytest.mark.parametrize("start", [None, replace(ONE, heat_capacity_J_per_K=40.0)])
def test_a_resistance_table_keeps_the_polarisation_that_is_given(start: ThermalModel | None) -> None:
    """Settled resistances of 50 mOhm, of which 20 mOhm are slow."""
    table = ResistanceTable(np.array([-1.0, 1.0]), DEGC, SOC, np.full((2, 1, 2), OHM))
    run = made(replace(ONE, polarisation_Ohm=0.0))
    late = polarisation_W_per_Ohm(run.current_A, 500.0, 1.0, table)
    heat = OHM * run.current_A**2 + 0.02 * late
    assert run.ambient_degC is not None
    nodes = ONE.simulate(heat, run.ambient_degC, 1.0, 19.0, run.current_A, np.full(len(run), 0.5))
    run = replace(run, temperature_degC=nodes[:, -1], voltage_V=np.full(len(run), np.nan))
    model = identify_thermal([run], [np.full(len(run), 0.5)], table, reversible=True, start=start).model
    if start is None:
        assert model.polarisation_Ohm == 0.0
        assert model.heat_capacity_J_per_K > 1.2 * 48.0
    else:
        assert model.polarisation_Ohm == 0.02
        assert model.heat_capacity_J_per_K == pytest.approx(48.0, rel=1e-6)


def test_a_chamber_that_moves_without_load_gives_only_the_time_constant() -> None:
    n = 4000
    ambient = 20.0 + 8.0 * np.sin(np.arange(n) / 300.0)
    temperature = ThermalModel(48.0, 0.13).simulate(np.zeros(n), ambient, 1.0, 20.0)[:, 0]
    temperature += 0.05 * np.random.default_rng(0).standard_normal(n)
    current = 0.1 * np.random.default_rng(1).standard_normal(n)
    says = "heat capacity and heat transfer to the ambient can change by a common"
    with pytest.raises(NotIdentifiableError, match=says):
        run = replace(hand_network.grid_run(current, temperature, ambient), voltage_V=3.6 + OHM * current)
        fitted([run], polarisation_s=None)


def test_a_second_node_that_the_data_do_not_show_is_refused() -> None:
    with pytest.raises(NotIdentifiableError, match="surface"):
        fitted([made(ONE, noise_K=0.05)], surface=True, start=ThermalModel(30.0, 0.13, 18.0, 2.0))


def test_a_negative_polarisation_is_a_reservation() -> None:
    run = made(replace(ONE, polarisation_Ohm=-0.02), noise_K=0.01)
    (text,) = fitted([run], reversible=True, polarisation_s=500.0).reservations
    assert "-20." in text and "must be positive" in text


def test_what_is_missing_is_named() -> None:
    run = made(ONE)
    with pytest.raises(ModelError, match="both the cell's and the ambient temperature"):
        fitted([replace(run, ambient_degC=None)])
    with pytest.raises(ModelError, match="SoC must be finite"):
        identify_thermal([run], [np.full(len(run) - 1, 0.5)], CONSTANT)
    with pytest.raises(ModelError, match="one for each"):
        identify_thermal([run], [], CONSTANT)
    with pytest.raises(ModelError, match="has a surface"):
        fitted([run], start=TWO)
    with pytest.raises(ModelError, match="no voltage was measured"):
        fitted([replace(run, voltage_V=np.full(len(run), np.nan))])
    gap = ResistanceTable(np.array([-1.0, 1.0]), DEGC, SOC, np.full((2, 1, 2), np.nan))
    with pytest.raises(ModelError, match="does not settle"):
        identify_thermal([run], [np.full(len(run), 0.5)], gap)
