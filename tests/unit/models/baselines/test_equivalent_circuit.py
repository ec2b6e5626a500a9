import json

import numpy as np
import pytest

from models.baselines import EquivalentCircuit, fit_equivalent_circuit
from models.baselines.circuit_problem import CircuitProblem, Layout
from models.baselines.samples import gather
from models.baselines.smoothness import default
from models.data.errors import ModelError, NotIdentifiableError, StructureError
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.network.free_run import free_run_V
from tests.unit.models import synthetic
from tests.unit.models.baselines import circuits

COLD_FACTOR = 1.6
NOISE_V = 5e-4


def two_temperatures(seed: int) -> list[TimeSeries]:
    return [
        circuits.run(6000, seed, temperature_degC=25.0),
        circuits.run(6000, seed + 1, temperature_degC=5.0, factor=COLD_FACTOR),
    ]


@pytest.fixture(scope="module")
def circuit() -> EquivalentCircuit:
    return fit_equivalent_circuit(two_temperatures(1), capacity_Ah=circuits.CAPACITY_AH)


def test_recovers_the_known_circuit_at_two_temperatures(circuit: EquivalentCircuit) -> None:
    low, high = circuit.record.domain["soc"]
    soc = np.linspace(low + 0.05, high - 0.05, 20)
    for degC, factor in ((25.0, 1.0), (5.0, COLD_FACTOR)):
        np.testing.assert_allclose(circuit.ocv_V.at(soc, degC), circuits.ocv_V(soc), atol=1.5e-3)
        np.testing.assert_allclose(circuit.r0_Ohm.at(soc, degC), factor * circuits.R0_OHM, rtol=0.05)
        fast, slow = (table.at(soc, degC).mean() for table in circuit.branches.resistances_Ohm)
        assert fast == pytest.approx(factor * circuits.R1_OHM, rel=0.05)
        assert slow == pytest.approx(factor * circuits.R2_OHM, rel=0.05)
        knot = int(np.argmin(np.abs(circuit.branches.temperature_degC - degC)))
        expected = factor * np.array([circuits.TAU1_S, circuits.TAU2_S])
        np.testing.assert_allclose(circuit.branches.time_constants_s[:, knot], expected, rtol=0.1)


def test_simulates_unseen_runs_to_the_noise(circuit: EquivalentCircuit) -> None:
    for series in two_temperatures(11):
        run = to_grid(series, 1.0)
        error = free_run_V(circuit, run, 0.6) - run.voltage_V
        assert np.sqrt(np.mean(error**2)) < 1.3 * NOISE_V
    assert circuit.record.held_out_rmse_mV == pytest.approx(1e3 * NOISE_V, rel=0.3)
    assert circuit.name == "2RC"


def test_one_branch_is_recovered_with_another_time_step() -> None:
    runs = [synthetic.run(4000, seed=s, noise_V=5e-4) for s in (1, 2)]
    circuit = fit_equivalent_circuit(runs, capacity_Ah=synthetic.CAPACITY_AH, n_branches=1)
    soc = np.array([0.55, 0.6])
    np.testing.assert_allclose(circuit.r0_Ohm.at(soc, 25.0), synthetic.R0_OHM, rtol=0.05)
    np.testing.assert_allclose(circuit.branches.time_constants_s, synthetic.TAU_S, rtol=0.1)
    # Continuous-time parameters: the same circuit runs on a finer grid.
    coarse, fine = (to_grid(runs[0], dt_s) for dt_s in (1.0, 0.5))
    at_s = free_run_V(circuit, fine, 0.6)[::2]
    np.testing.assert_allclose(at_s, free_run_V(circuit, coarse, 0.6), atol=1e-4)


def test_nothing_is_negative_and_the_curve_rises() -> None:
    series = synthetic.run(1500, seed=3, noise_V=0.02)
    circuit = fit_equivalent_circuit([series], capacity_Ah=synthetic.CAPACITY_AH)
    assert (np.diff(circuit.ocv_V.values, axis=0) >= -1e-12).all()
    for table in (circuit.r0_Ohm, *circuit.branches.resistances_Ohm):
        assert (table.values >= 0.0).all()


def test_document_round_trip(circuit: EquivalentCircuit) -> None:
    again = EquivalentCircuit.from_json(json.loads(json.dumps(circuit.to_json())))
    run = to_grid(two_temperatures(21)[1], 1.0)
    np.testing.assert_array_equal(free_run_V(again, run, 0.6), free_run_V(circuit, run, 0.6))
    assert again.record == circuit.record


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("kind", "local_model_network", "kind"),
        ("schema_version", 99, "99"),
        ("ocv_V", {"soc": [0.0]}, "damaged"),
        ("dt_s", -1.0, "grid step"),
        ("cell", {"capacity_Ah": 0.0, "efficiency": 1.0}, "capacity"),
    ],
)
def test_refuses_damaged_documents(circuit: EquivalentCircuit, key: str, value: object, said: str) -> None:
    with pytest.raises(StructureError, match=said):
        EquivalentCircuit.from_json(circuit.to_json() | {key: value})


def test_needs_the_temperature_that_its_tables_depend_on(circuit: EquivalentCircuit) -> None:
    series = two_temperatures(1)[0]
    nothing = np.full(len(series), np.nan)
    blind = TimeSeries(series.time_s, series.current_A, series.voltage_V, nothing, None, series.soc_ref)
    with pytest.raises(StructureError, match="temperature"):
        free_run_V(circuit, to_grid(blind, 1.0), 0.6)
    without = fit_equivalent_circuit([blind], capacity_Ah=circuits.CAPACITY_AH, n_branches=1)
    assert np.isfinite(free_run_V(without, to_grid(blind, 1.0), 0.6)).all()


def series_of(current_A: np.ndarray, initial_soc: float = 0.5, missing: np.ndarray | None = None) -> TimeSeries:
    n = len(current_A)
    soc = initial_soc + np.cumsum(current_A) / (3600.0 * circuits.CAPACITY_AH)
    voltage = np.where(np.zeros(n, dtype=bool) if missing is None else missing, np.nan, 3.4 + 0.02 * current_A)
    reference = np.where(np.arange(n) == 0, soc, np.nan)
    return TimeSeries(np.arange(n) * 1.0, current_A, voltage, np.full(n, 25.0), None, reference, "run")


@pytest.mark.parametrize(
    ("current_A", "said"),
    [
        (np.full(1500, -0.5), "changes only 0 times"),
        (np.zeros(1500), "never exceeds"),
        (np.tile([0.5, -0.5], 50), "usable samples"),
        (np.tile(np.repeat([1.0, 0.0, -1.0, 0.0], 10), 50), "stays within"),
        (np.repeat(np.tile([-100.0, 0.0], 50), 10), "capacity, initial state of charge"),
    ],
)
def test_refuses_what_no_circuit_can_be_seen_in(current_A: np.ndarray, said: str) -> None:
    with pytest.raises(NotIdentifiableError, match=said):
        fit_equivalent_circuit([series_of(current_A)], capacity_Ah=circuits.CAPACITY_AH)


def test_names_what_cannot_be_told_apart() -> None:
    # Wherever the voltage is known the current is the same.
    off = np.arange(2000) % 200 == 100
    series = series_of(np.where(off, 0.0, -0.5), 0.9, missing=off)
    with pytest.raises(NotIdentifiableError, match="the open-circuit voltage.*cannot be told apart") as refusal:
        fit_equivalent_circuit([series], capacity_Ah=circuits.CAPACITY_AH, n_branches=1)
    assert "the series resistance" in str(refusal.value)


def test_refuses_bad_arguments() -> None:
    series = two_temperatures(1)[:1]
    with pytest.raises(ModelError, match="3 branches"):
        fit_equivalent_circuit(series, capacity_Ah=1.0, n_branches=3)
    with pytest.raises(ModelError, match="must be positive"):
        fit_equivalent_circuit(series, capacity_Ah=float("nan"))
    with pytest.raises(ModelError, match="no training run"):
        fit_equivalent_circuit([], capacity_Ah=1.0)


def test_error_gradient_is_the_derivative_with_the_best_tables() -> None:
    samples = gather(two_temperatures(1), circuits.CAPACITY_AH, None, None)
    knots = np.array([5.0, 25.0])
    layout = Layout(np.linspace(0, 1, 11), knots, np.linspace(0, 1, 4), knots, 2, hysteresis=True)
    problem = CircuitProblem(samples, layout)
    theta = np.array([-np.log([5.0, 12.0]), -np.log([60.0, 150.0]), np.log([20.0, 30.0])])
    terms = problem.terms(theta)
    penalty = default(terms, problem.sums(terms, problem.thinned)).penalty
    _, gradient = problem.cost_and_gradient(theta, penalty)
    for index in np.ndindex(*theta.shape):
        moved = np.zeros_like(theta)
        moved[index] = 1e-4
        ends = [problem.cost_and_gradient(theta + sign * moved, penalty)[0] for sign in (1.0, -1.0)]
        assert gradient[index] == pytest.approx((ends[0] - ends[1]) / 2e-4, rel=1e-3, abs=1e-12)
