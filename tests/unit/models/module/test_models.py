import json

import numpy as np
import pytest

from models.data.errors import ModelError, NotIdentifiableError
from models.data.timeseries import TimeSeries
from models.module.models import (
    ModuleComparison,
    ModuleModel,
    ModuleRun,
    as_cell_run,
    compare_module_models,
    identify_module,
)
from simulators.catalogue import CELLS
from simulators.cell import Cell
from simulators.module import Module, ModuleLayout
from tests.unit.models import simulated_cells

SERIES, PARALLEL = 4, 2


def made(seed: int, noise_V: float = 0.0, n: int = 2000) -> ModuleRun:
    """A module that is exactly S4: 20 mOhm and 30 mV on charge, 15 mOhm and -10 mV else."""
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.uniform(-10.0, 8.0, n // 20) * (rng.random(n // 20) < 0.8), 20)
    cell = 3.6 + 0.02 * current / PARALLEL + 0.1 * np.sin(np.arange(n) / 300.0)
    charge = current > 0.0
    module = SERIES * cell + np.where(charge, 0.020 * current + 0.030, 0.015 * current - 0.010)
    return ModuleRun(module + noise_V * rng.standard_normal(n), current, cell)


def test_equations_with_their_signs() -> None:
    cell, current = np.array([3.7, 3.6, 3.5]), np.array([4.0, 0.0, -6.0])

    def volts(kind: str, **values: tuple[float, float]) -> np.ndarray:
        return ModuleModel(kind, 3, 2, **values).voltage_V(cell, current)

    np.testing.assert_allclose(volts("S1"), [11.1, 10.8, 10.5])
    np.testing.assert_allclose(volts("S2", resistance_Ohm=(0.01, 0.01)), [11.14, 10.8, 10.44])
    both = {"resistance_Ohm": (0.01, 0.02), "offset_V": (0.3, -0.2)}
    np.testing.assert_allclose(volts("S4", **both), [11.44, 10.6, 10.18])
    np.testing.assert_allclose(ModuleModel("S1", 3, 2).cell_current_A(current), [2.0, 0.0, -3.0])


def test_each_model_finds_what_it_can_say() -> None:
    run = made(0)
    s4 = identify_module("S4", [run], SERIES, PARALLEL)
    np.testing.assert_allclose(s4.resistance_Ohm, [0.020, 0.015], rtol=1e-9)
    np.testing.assert_allclose(s4.offset_V, [0.030, -0.010], rtol=1e-8)
    plain = ModuleRun(SERIES * run.cell_voltage_V + 0.017 * run.current_A + 0.05, run.current_A, run.cell_voltage_V)
    s3 = identify_module("S3", [plain], SERIES, PARALLEL)
    assert s3.resistance_Ohm[0] == s3.resistance_Ohm[1] == pytest.approx(0.017, rel=1e-9)
    assert s3.offset_V[0] == pytest.approx(0.05, rel=1e-9)
    s2 = identify_module("S2", [plain], SERIES, PARALLEL)
    assert s2.resistance_Ohm[0] == pytest.approx(0.017 + 0.05 * plain.current_A.sum() / (plain.current_A**2).sum())
    assert s2.offset_V == (0.0, 0.0)


def test_standard_deviations_hold_over_repeated_fits() -> None:
    scores = []
    for seed in range(60):
        model = identify_module("S4", [made(seed, noise_V=0.02)], SERIES, PARALLEL)
        errors = np.array(model.resistance_Ohm + model.offset_V) - [0.020, 0.015, 0.030, -0.010]
        scores.append(errors / np.array(model.resistance_std_Ohm + model.offset_std_V))
    spread = np.sqrt(np.mean(np.square(scores), axis=0))
    assert (spread > 0.75).all() and (spread < 1.3).all()


def test_errors_fall_side_by_side_and_missing_samples_do_not_count() -> None:
    train, other = made(1, noise_V=0.001), made(2, noise_V=0.001)
    train.voltage_V[100:200] = np.nan
    found = compare_module_models([train], SERIES, PARALLEL, validate=[other])
    for figures in (found.train, found.validation):
        rmse = [figures[kind]["rmse_mV"] for kind in ("S1", "S2", "S3", "S4")]
        assert rmse == sorted(rmse, reverse=True)
        assert rmse[-1] == pytest.approx(1.0, rel=0.1)
        assert rmse[0] > 50.0
    assert found.train["S4"]["n_samples"] == 1900
    assert found.reservations == ()
    document = json.loads(json.dumps(found.to_json()))
    assert ModuleModel.from_json(document["models"]["S4"]) == found.models["S4"]
    assert document["validation"]["S2"]["rmse_mV"] == found.validation["S2"]["rmse_mV"]


@pytest.fixture(scope="module")
def simulated() -> tuple[ModuleLayout, ModuleComparison]:
    """Three groups of two unequal NMC cells with connectors; the cell model is the type itself."""
    p = CELLS["nmc"].parameters
    layout = ModuleLayout(
        cells_in_series=3,
        cells_in_parallel=2,
        connector_resistance_Ohm=0.003,
        capacity_spread=0.02,
        resistance_spread=0.05,
        soc_spread=0.01,
        seed=3,
    )
    runs = []
    for seed in (1, 2):
        current = simulated_cells.pulses_A(2000, p.capacity_Ah, seed)
        module = simulated_cells.record(Module(p, layout, 0.6, 25.0), 2.0 * current, seed, ambient_degC=25.0)
        one = as_cell_run(module, 3, 2)
        np.testing.assert_allclose(one.current_A, current)
        cell = simulated_cells.record(Cell(p, 0.6, 25.0), one.current_A, seed, voltage_noise_V=0.0, ambient_degC=25.0)
        runs.append(ModuleRun(module.voltage_V, module.current_A, cell.voltage_V))
    return layout, compare_module_models(runs[:1], 3, 2, validate=runs[1:])


def test_error_falls_from_s1_to_s4_on_a_simulated_module(simulated: tuple[ModuleLayout, ModuleComparison]) -> None:
    _, found = simulated
    train = [found.train[kind]["rmse_mV"] for kind in ("S1", "S2", "S3", "S4")]
    assert train == sorted(train, reverse=True)
    validation = [found.validation[kind]["rmse_mV"] for kind in ("S1", "S2", "S3", "S4")]
    assert validation[1] < 0.1 * validation[0]
    assert validation[3] < 2.0


def test_identified_resistance_is_that_of_the_connectors(simulated: tuple[ModuleLayout, ModuleComparison]) -> None:
    layout, found = simulated
    for kind in ("S2", "S3", "S4"):
        np.testing.assert_allclose(found.models[kind].resistance_Ohm, layout.connectors_Ohm, rtol=0.05)


def run_of(current_A: np.ndarray) -> ModuleRun:
    return ModuleRun(4 * 3.6 + 0.02 * current_A, current_A, np.full(len(current_A), 3.6))


@pytest.mark.parametrize(
    ("kind", "current_A", "says"),
    [
        ("S2", np.zeros(500), "S2: the module's current is 0 A wide: resistance cannot"),
        ("S3", np.full(500, -4.0), "S3: the module's current is 0 A wide: resistance and offset cannot"),
        ("S4", np.linspace(-5.0, 0.0, 500), "S4: only 0 sample.s. while charging"),
        ("S4", np.where(np.arange(500) < 250, 3.0, -np.arange(500) / 100.0), "current while charging is 0 A wide"),
        ("S2", np.arange(10.0), "10 usable"),
    ],
)
def test_data_that_do_not_determine_a_model_are_refused(kind: str, current_A: np.ndarray, says: str) -> None:
    with pytest.raises(NotIdentifiableError, match=says):
        identify_module(kind, [run_of(current_A)], 4, 1)


def test_a_model_that_is_not_determined_is_left_out_with_its_reason() -> None:
    found = compare_module_models([run_of(np.linspace(-5.0, 0.0, 500))], 4, 1)
    assert list(found.models) == ["S1", "S2", "S3"]
    (text,) = found.reservations
    assert "while charging" in text


def test_sensor_noise_at_rest_keeps_to_one_direction_above_the_rest_current() -> None:
    run = made(0)
    noisy = ModuleRun(
        run.voltage_V, run.current_A + 1e-3 * np.random.default_rng(0).standard_normal(2000), run.cell_voltage_V
    )
    model = identify_module("S4", [noisy], SERIES, PARALLEL, rest_A=0.01)
    np.testing.assert_allclose(model.offset_V, [0.030, -0.010], rtol=0.02)


def test_impossible_modules_and_documents_are_refused() -> None:
    with pytest.raises(ModelError, match="S5"):
        ModuleModel("S5", 4, 1)
    with pytest.raises(ModelError, match="has no cell"):
        ModuleModel("S1", 0, 1)
    with pytest.raises(ModelError, match="no run"):
        compare_module_models([], 4, 1)
    with pytest.raises(ModelError, match="differ in length"):
        ModuleRun(np.zeros(3), np.zeros(3), np.zeros(2))
    document = ModuleModel("S1", 4, 1).to_json()
    with pytest.raises(ModelError, match="damaged"):
        ModuleModel.from_json(document | {"offset_V": [0.0]})
    with pytest.raises(ModelError, match="not a module model"):
        ModuleModel.from_json({})
    with pytest.raises(ModelError):
        ModuleModel.from_json([])  # pyright: ignore[reportArgumentType]


def test_a_module_run_becomes_its_mean_cells() -> None:
    series = TimeSeries(np.arange(3.0), np.array([0.0, 4.0, -8.0]), np.array([14.4, 14.8, 14.0]), np.full(3, 25.0))
    cell = as_cell_run(series, 4, 2)
    np.testing.assert_allclose(cell.current_A, [0.0, 2.0, -4.0])
    np.testing.assert_allclose(cell.voltage_V, [3.6, 3.7, 3.5])
