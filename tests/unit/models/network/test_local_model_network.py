import json
from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError, NotIdentifiableError, StructureError
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.identification.lolimot import construct
from models.identification.output_error import HeldOutChoice, normal_equations, refine, stabilised
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.recursion import free_run
from models.network.regression import CellContext, build_dataset, find_scaling
from models.network.structure import Structure, full_structure, minimal_structure
from models.pipeline.fit import fit_network
from tests.unit.models import synthetic

CELL = CellContext(synthetic.CAPACITY_AH)


def problem(structure: Structure, n: int = 3000, noise_V: float = 0.0, max_models: int = 8):
    run = synthetic.run(n, seed=1, noise_V=noise_V)
    grid, soc = [to_grid(run, 1.0)], [0.6]
    scaling = find_scaling(structure, grid, soc, CELL)
    data = build_dataset(structure, scaling, grid, soc, CELL)
    *_, local = construct(structure, data, max_models)
    return data, local, scaling


def test_parts_of_which_no_sample_is_kept_have_no_start() -> None:
    structure = full_structure(1.0, 0, 1, 100.0)
    whole = to_grid(synthetic.run(101, seed=1), 1.0)
    # Every third is kept: none of 4, and none of what begins at the last sample.
    grid, soc = [replace(whole, segment_starts=(0, 4, 5, 100)), whole], [0.6, 0.6]
    scaling = find_scaling(structure, grid, soc, CELL)
    data = build_dataset(structure, scaling, grid, soc, CELL, keep_every=3)
    assert len(data) == 2 * 34
    assert data.starts.tolist() == [0, 2, 34]


@pytest.mark.parametrize("order", [0, 1, 2])
def test_sensitivities_match_finite_differences(order: int) -> None:
    structure = full_structure(1.0, order, 1, 100.0)
    data, local, _ = problem(structure, n=800)
    theta = stabilised(local.theta, order)
    gradient = normal_equations(theta, order, local.partition, data).gradient
    validity = local.partition.validity(data.z)

    def cost(x: np.ndarray) -> float:
        error = (data.y - free_run(x, order, validity, data))[order:]
        return 0.5 * float(error @ error)

    step = 1e-6
    for i, j in [(0, 0), (2, order), (3, order + 1), (5, structure.n_regressors - 1)]:
        up, down = theta.copy(), theta.copy()
        up[i, j] += step
        down[i, j] -= step
        numeric = -(cost(up) - cost(down)) / (2 * step)
        assert gradient.reshape(theta.shape)[i, j] == pytest.approx(numeric, rel=1e-4, abs=1e-7)


def test_construction_keeps_to_the_axes_that_may_be_split() -> None:
    _, local, _ = problem(full_structure(1.0, 1, 1, 100.0), max_models=12)
    widths = local.partition.upper - local.partition.lower
    np.testing.assert_allclose(widths[:, 1], 0.5)
    np.testing.assert_allclose(widths[:, 2], 1 / 3)


def test_construction_lowers_the_one_step_error() -> None:
    structure = minimal_structure(1.0)
    data, _, _ = problem(structure)
    losses = [fit.loss.sum() for fit in construct(structure, data, 6)]
    assert losses[-1] < losses[0]


def test_refinement_never_worsens_the_training_error_and_reaches_the_noise() -> None:
    structure = minimal_structure(1.0)
    data, local, scaling = problem(structure, n=6000, noise_V=1e-3)
    span_mV = 1e3 * (scaling["voltage"][1] - scaling["voltage"][0])
    validity = local.partition.validity(data.z)
    before = np.sqrt(np.mean((data.y - free_run(stabilised(local.theta, 1), 1, validity, data)) ** 2)) * span_mV
    size = local.partition.n_models * (structure.n_regressors - 1)
    fold = np.arange(len(data)) * 5 // len(data)
    refined = refine(local.theta, 1, local.partition, data, HeldOutChoice([np.zeros((size, size))], fold, (-8.0,)))
    assert refined.rmse * span_mV <= before
    assert refined.rmse * span_mV < 1.3


def test_poles_stay_inside_the_unit_circle() -> None:
    wild = np.array([[1.7, -0.5, 0.0], [0.3, 0.9, 0.0], [-2.0, 0.1, 0.0]])
    for row in stabilised(wild, 2):
        assert np.abs(np.roots([1.0, -row[0], -row[1]])).max() < 1.0
    assert stabilised(np.array([[1.2, 0.0]]), 1)[0, 0] < 1.0


@pytest.fixture(scope="module")
def fitted():
    train = [synthetic.run(5000, seed=2, noise_V=1e-3, name="a")]
    valid = [synthetic.run(3000, seed=9, noise_V=1e-3, name="b")]
    return fit_network(train, capacity_Ah=synthetic.CAPACITY_AH, structure="minimal", validate=valid)


def test_held_out_error_comes_near_the_noise(fitted) -> None:
    assert fitted.validation is not None
    assert fitted.validation["rmse_mV"] < 1.5
    assert fitted.network.record.noise_floor_mV == pytest.approx(1.0, rel=0.15)
    assert len(fitted.candidates) > 5


def test_document_gives_the_same_free_run(fitted) -> None:
    again = LocalModelNetwork.from_json(json.loads(json.dumps(fitted.network.to_json())))
    run = to_grid(synthetic.run(500, seed=4), 1.0)
    np.testing.assert_array_equal(free_run_V(again, run, 0.6), free_run_V(fitted.network, run, 0.6))


def test_free_run_stays_bounded_on_adversarial_current(fitted) -> None:
    n = 4000
    current = np.where(np.arange(n) % 2 == 0, 60.0, -60.0)
    run = TimeSeries(np.arange(n) * 1.0, current, np.full(n, 3.7), np.full(n, 80.0))
    simulated = free_run_V(fitted.network, to_grid(run, 1.0), 0.5)
    assert np.isfinite(simulated).all()
    assert np.abs(simulated).max() < 100.0


@pytest.mark.parametrize(
    "damage",
    [
        {"kind": "other"},
        {"schema_version": 99},
        {"theta": [[1.0]]},
        {"theta": "text"},
        {"scaling": {}},
        {"structure": {"output_order": 1}},
        {"cell": {"capacity_Ah": float("nan"), "efficiency": 1.0}},
        {"cell": {"capacity_Ah": -1.0, "efficiency": 1.0}},
        {"cell": {"capacity_Ah": True, "efficiency": 1.0}},
        {"cell": {"capacity_Ah": 10**400, "efficiency": 1.0}},
        {"partition": {"lower": 5, "upper": 6}},
        {"scaling": {"soc": [1.0, 1.0], "current": [-1.0, 1.0], "voltage": [3.0, 4.0]}},
        {"scaling": {"soc": ["0", "1"], "current": [-1.0, 1.0], "voltage": [3.0, 4.0]}},
        {"record": 5},
    ],
)
def test_damaged_documents_are_refused(fitted, damage: dict) -> None:
    with pytest.raises(StructureError):
        LocalModelNetwork.from_json(fitted.network.to_json() | damage)


def test_a_given_structure_is_kept() -> None:
    given = minimal_structure(1.0, 1, 3, 0.6)
    run = synthetic.run(3000, seed=2, noise_V=1e-3)
    fitted = fit_network([run], capacity_Ah=synthetic.CAPACITY_AH, structure=given)
    assert fitted.network.structure == given
    assert fitted.train["rmse_mV"] < 2.0


@pytest.mark.proof
def test_auto_finds_what_the_cell_is_made_of() -> None:
    runs = [synthetic.run(5000, seed=s, noise_V=1e-3, name=str(s)) for s in (2, 5, 6, 9)]
    fitted = fit_network(runs[:3], capacity_Ah=synthetic.CAPACITY_AH, structure="auto", validate=runs[3:])
    assert fitted.network.structure.output_order == 0
    assert fitted.validation is not None and fitted.validation["rmse_mV"] < 1.3


def series(current: np.ndarray) -> TimeSeries:
    n = len(current)
    return TimeSeries(np.arange(n) * 1.0, current, 3.7 + 0.01 * current, np.full(n, 25.0), None, np.full(n, 0.5))


@pytest.mark.parametrize(
    ("current", "says"),
    [
        (np.full(2000, -1.0), "constant current"),
        (np.zeros(2000), "never exceeds"),
        (np.ones(3), "usable samples"),
        (np.tile([60.0] * 50 + [-1.0] * 10, 60), "capacity"),
    ],
)
def test_data_that_cannot_determine_a_model_are_refused(current: np.ndarray, says: str) -> None:
    with pytest.raises(NotIdentifiableError, match=says):
        fit_network([series(current)], capacity_Ah=2.0, structure="minimal")


def test_a_run_without_initial_soc_is_refused_with_the_way_out() -> None:
    run = synthetic.run(1000, seed=1)
    bare = TimeSeries(run.time_s, run.current_A, run.voltage_V, run.temperature_degC)
    with pytest.raises(ModelError, match="--initial-soc"):
        fit_network([bare], capacity_Ah=2.0, structure="minimal")


def test_the_full_structure_asks_for_temperature() -> None:
    run = synthetic.run(1000, seed=1)
    cold = TimeSeries(run.time_s, run.current_A, run.voltage_V, np.full(1000, np.nan), None, run.soc_ref)
    with pytest.raises(NotIdentifiableError, match="--structure minimal"):
        fit_network([cold], capacity_Ah=2.0, structure="full")
