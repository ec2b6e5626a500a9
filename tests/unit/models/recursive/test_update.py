import json

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.resampling import GridRun, to_grid
from models.data.timeseries import TimeSeries
from models.identification.search.auto import AutoCandidate
from models.identification.search.candidate import Candidate
from models.identification.search.search import Search
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import ModelRecord
from models.network.partition import Partition
from models.network.regression import CellContext, build_dataset
from models.recursive.settings import UpdateSettings
from models.recursive.state import UpdateState
from models.recursive.update import RecursiveUpdate
from tests.unit.models import synthetic
from tests.unit.models.hand_network import everything, grid_run

SETTINGS = UpdateSettings(memory_s=3600.0, voltage_std_V=2e-3, error_memory_s=1e-9)


def adversarial(n: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Current, voltage and temperature with everything in them that a broken bench could send."""
    rng = np.random.default_rng(seed)
    current = rng.normal(0.0, 5.0, n) * 10.0 ** rng.integers(-2, 6, n)
    voltage = rng.normal(3.7, 1.0, n) * 10.0 ** rng.integers(-1, 4, n)
    temperature = rng.normal(25.0, 60.0, n)
    for values, bad in ((current, np.inf), (voltage, -np.inf), (temperature, np.nan), (current, np.nan)):
        values[rng.random(n) < 0.05] = bad
    current[100:110] = 1e300
    return current, voltage, temperature


def spread_run(n: int, seed: int) -> tuple[GridRun, np.ndarray]:
    """A run over every operating point of the hand-made networks, with a voltage near what they say."""
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.uniform(-6.0, 4.0, n // 10), 10)
    run = grid_run(current, 20.0 + 15.0 * np.sin(np.arange(n) / 50.0))
    return run, rng.normal(0.0, 2e-3, n)


def twin(update: RecursiveUpdate, run: GridRun, voltage_V: np.ndarray, soc: float) -> tuple[np.ndarray, np.ndarray]:
    """The recursion in plain NumPy, on regressors made over the whole run; parameters and errors in V."""
    network, rule = update.network, update._rule
    order, (n_models, p) = network.structure.output_order, network.theta.shape
    data = build_dataset(network.structure, network.scaling, [run], [soc], network.cell)
    validity = network.partition.validity(data.z)
    low, high = network.scaling["voltage"]
    y = (voltage_V - low) / (high - low)
    theta, covariance = network.theta.copy(), rule.prior.copy()
    past, sensitivity, errors = [], [], np.zeros(len(y))
    for k in range(len(y)):
        if k < order:
            past.insert(0, y[k])
            sensitivity.insert(0, np.zeros((n_models, p)))
            continue
        phi = np.concatenate([past[:order], data.u[k]])
        blended = validity[k] @ theta
        simulated = float(blended @ phi)
        psi = validity[k][:, None] * phi
        for lag in range(order):
            psi = psi + blended[lag] * sensitivity[lag]
        gain = np.einsum("ipq,iq->ip", covariance, psi)
        variance = rule.noise + float(np.sum(gain * psi))
        errors[k] = y[k] - simulated
        bound = 4.0 * np.sqrt(variance)
        theta = np.clip(theta + gain * np.clip(errors[k], -bound, bound) / variance, rule.low, rule.high)
        covariance = covariance - gain[:, :, None] * gain[:, None, :] / variance
        covariance += (rule.forgetting * validity[k])[:, None, None] * (rule.prior - covariance)
        if order == 1:
            theta[:, 0] = np.clip(theta[:, 0], 0.0, 0.9995)
        elif order == 2:
            for row in theta:
                poles = np.clip(np.roots([1.0, -row[0], -row[1]]).real, -0.5, 0.9995)
                row[0], row[1] = poles.sum(), -poles.prod()
        past.insert(0, simulated)
        sensitivity.insert(0, psi)
    return theta, errors * (high - low)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_step_replay_and_a_plain_twin_agree(order: int) -> None:
    update = RecursiveUpdate(everything(order), SETTINGS)
    run, noise = spread_run(400, seed=order)
    voltage = free_run_V(update.network, run, 0.5)
    voltage = np.where(np.isnan(voltage), 3.6, voltage) + noise
    theta, errors = twin(update, run, voltage, 0.5)
    end, out = update.replay(update.initial(0.5), run.current_A, voltage, run.temperature_degC)
    state, single = update.initial(0.5), []
    for sample in zip(run.current_A, voltage, run.temperature_degC, strict=True):
        state, said = update.step(state, *sample)
        single.append((said.model_voltage_V, said.error_V, said.error_std_V))
    np.testing.assert_array_equal(state.theta, end.theta)
    np.testing.assert_array_equal(state.covariance, end.covariance)
    np.testing.assert_array_equal(np.array(single), out)
    np.testing.assert_allclose(end.theta, theta, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(out[order:, 1], errors[order:], rtol=0.0, atol=1e-12)
    assert np.abs(end.theta - update.network.theta).max() > 1e-4


@pytest.mark.parametrize("order", [0, 1, 2])
def test_without_anything_to_learn_the_error_is_that_of_the_free_run(order: int) -> None:
    update = RecursiveUpdate(everything(order), UpdateSettings(voltage_std_V=1e6))
    run, noise = spread_run(300, seed=4)
    voltage = 3.6 + noise
    measured = GridRun(**{**vars(run), "voltage_V": voltage, "measured": np.ones(300, bool)})
    _, out = update.replay(update.initial(0.5), run.current_A, voltage, run.temperature_degC)
    np.testing.assert_allclose(out[:, 0], free_run_V(update.network, measured, 0.5), atol=1e-9)


def fitted(candidate: Candidate | AutoCandidate, seeds: tuple[int, ...] = (1, 2, 3)) -> LocalModelNetwork:
    """A network of a new cell, without any search."""
    runs = [to_grid(synthetic.run(4000, seed=s, noise_V=1e-3), 1.0) for s in seeds]
    cell = CellContext(synthetic.CAPACITY_AH)
    found = Search(runs, [0.6] * len(runs), cell, lambda share, text: None).fitted(candidate)
    record = ModelRecord(train={"rmse_mV": 2.0})
    return LocalModelNetwork(found.structure, found.partition, found.theta, found.scaling, cell, record)


def learned(update: RecursiveUpdate, runs: list[TimeSeries]) -> UpdateState:
    state = update.initial(0.6)
    for run in runs:
        state, _ = update.replay(update.resumed(state, 0.6), run.current_A, run.voltage_V, run.temperature_degC)
    return state


def rmse_mV(network: LocalModelNetwork, run: TimeSeries) -> float:
    return 1e3 * float(np.sqrt(np.mean((free_run_V(network, to_grid(run, 1.0), 0.6) - run.voltage_V) ** 2)))


CANDIDATES = {
    "no past outputs": AutoCandidate(synthetic.CAPACITY_AH, time_constants_s=(3.0, 20.0), n_models=6),
    "one past output": Candidate("minimal", (20.0,), 1, n_models=6),
    "two past outputs": Candidate("minimal", (4.0, 20.0), 2, n_models=4),
}


@pytest.mark.parametrize("candidate", CANDIDATES.values(), ids=CANDIDATES)
def test_a_cell_whose_resistance_has_grown_is_followed(
    candidate: Candidate | AutoCandidate, monkeypatch: pytest.MonkeyPatch
) -> None:
    update = RecursiveUpdate(fitted(candidate), UpdateSettings(memory_s=6 * 3600.0))
    monkeypatch.setattr(synthetic, "R0_OHM", 1.5 * synthetic.R0_OHM)
    seen = [synthetic.run(4000, seed=s, noise_V=1e-3) for s in (11, 12)]
    later = synthetic.run(4000, seed=13, noise_V=1e-3)
    before = rmse_mV(update.network, later)
    network = update.updated(learned(update, seen))
    after = rmse_mV(network, later)
    assert before > 15.0
    assert after < 0.25 * before
    assert LocalModelNetwork.from_json(json.loads(json.dumps(network.to_json()))).theta.shape == network.theta.shape


def test_a_cell_that_has_not_changed_is_left_as_it_is() -> None:
    update = RecursiveUpdate(fitted(Candidate("minimal", (20.0,), 1, n_models=6)))
    later = synthetic.run(4000, seed=13, noise_V=1e-3)
    network = update.updated(learned(update, [synthetic.run(4000, seed=s, noise_V=1e-3) for s in (11, 12)]))
    assert rmse_mV(network, later) < rmse_mV(update.network, later) + 0.1


@pytest.mark.parametrize("order", [0, 1, 2])
def test_any_input_leaves_the_parameters_finite_and_the_poles_stable(order: int) -> None:
    update = RecursiveUpdate(everything(order), SETTINGS)
    state, _ = update.replay(update.initial(0.5), *adversarial(20_000, seed=order))
    assert np.isfinite(state.theta).all()
    assert np.isfinite(state.covariance).all()
    for row in state.theta:
        assert np.abs(np.roots([1.0, *-row[:order]])).max(initial=0.0) < 1.0
    variance = np.einsum("ipp->ip", state.covariance)
    assert (variance <= np.einsum("ipp->ip", update._rule.prior) * (1.0 + 1e-9)).all()
    assert (variance > 0.0).all()
    assert (np.linalg.eigvalsh(state.covariance) > -1e-12).all()


def test_a_long_time_without_excitation_changes_nothing() -> None:
    update = RecursiveUpdate(everything(0), UpdateSettings(memory_s=100.0, voltage_std_V=2e-3))
    n = 50_000
    rest, degC = np.zeros(n), np.full(n, 20.0)
    settled = update.replay(update.initial(0.5), rest, np.full(n, np.nan), degC)[1][-1, 0]
    rng = np.random.default_rng(0)
    state, out = update.replay(update.initial(0.5), rest, settled + rng.normal(0.0, 2e-3, n), degC)
    assert np.abs(out[-1000:, 0] - settled).max() < 5e-3
    reach = np.sqrt(np.einsum("ipp->ip", update._rule.prior))
    assert (np.abs(state.theta - update.network.theta) < reach).all()


def test_missing_voltages_teach_nothing_and_a_given_soc_is_used() -> None:
    update = RecursiveUpdate(everything(1), SETTINGS)
    run, _ = spread_run(200, seed=3)
    state, out = update.replay(update.initial(0.5), run.current_A, np.full(200, np.nan), run.temperature_degC)
    np.testing.assert_array_equal(state.theta, update.network.theta)
    assert np.isnan(out[:, 1]).all()
    counted = 0.5 + np.concatenate([[0.0], np.cumsum(run.current_A[1:])]) / 7200.0
    assert state.soc == pytest.approx(counted[-1] if len(counted) else 0.5, abs=1e-9)
    given, _ = update.step(state, 0.0, 3.7, 25.0, soc=0.42)
    assert given.soc == 0.42
    assert state.n_samples == 200


def test_order_zero_is_weighted_least_squares_of_each_local_model() -> None:
    network = everything(0)
    one = Partition(np.zeros((1, 4)), np.ones((1, 4)), network.partition.k_sigma)
    single = LocalModelNetwork(network.structure, one, network.theta[:1], network.scaling, network.cell, network.record)
    update = RecursiveUpdate(single, UpdateSettings(memory_s=1e12, voltage_std_V=1.0))
    run, noise = spread_run(300, seed=8)
    voltage = free_run_V(single, run, 0.5) + noise + 0.02 * run.current_A
    state, _ = update.replay(update.initial(0.5), run.current_A, voltage, run.temperature_degC)
    data = build_dataset(single.structure, single.scaling, [run], [0.5], single.cell)
    low, high = single.scaling["voltage"]
    information = np.linalg.inv(update._rule.prior[0])
    weight = 1.0 / update._rule.noise
    away = (voltage - low) / (high - low) - data.u @ single.theta[0]
    expected = single.theta[0] + np.linalg.solve(information + weight * data.u.T @ data.u, weight * data.u.T @ away)
    np.testing.assert_allclose(state.theta[0], expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_settings_out_of_range_are_refused(value: float) -> None:
    with pytest.raises(ModelError, match="memory_s"):
        UpdateSettings(memory_s=value)
