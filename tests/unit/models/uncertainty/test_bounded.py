"""What a bounded network does not know: bands that hold on runs it did not see, and its document."""

import json
from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import GridRun, to_grid
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.uncertainty.bands import prediction_band
from models.uncertainty.model_uncertainty import Uncertainty, uncertainty_of
from tests.unit.models.diagnosis.cells import SOC
from tests.unit.models.pipeline.bounded_cell import fitted, run


@pytest.fixture(scope="module")
def network() -> LocalModelNetwork:
    return fitted().network


@pytest.fixture(scope="module")
def known(network: LocalModelNetwork) -> Uncertainty:
    found = uncertainty_of(network)
    assert found is not None
    return found


def grid(seed: int) -> GridRun:
    return to_grid(run(seed), 1.0)


@pytest.mark.parametrize("seed", [9, 10, 12])
def test_bands_hold_on_unseen_runs(network: LocalModelNetwork, known: Uncertainty, seed: int) -> None:
    band = prediction_band(network, grid(seed), SOC, known)
    assert 0.90 <= band.coverage_95(grid(seed).voltage_V) <= 0.98
    error_V = grid(seed).voltage_V - band.voltage_V
    assert float(np.mean(band.upper_V - band.lower_V)) / 2.0 < 3.0 * float(np.sqrt(np.mean(error_V**2)))
    np.testing.assert_allclose(band.voltage_V, free_run_V(network, grid(seed), SOC))


def test_bands_grow_outside_the_trained_ranges(network: LocalModelNetwork, known: Uncertainty) -> None:
    plain = grid(9)
    inside = prediction_band(network, plain, SOC, known)
    cold = prediction_band(network, replace(plain, temperature_degC=plain.temperature_degC - 30.0), SOC, known)
    loaded = prediction_band(network, replace(plain, current_A=3.0 * plain.current_A), SOC, known)
    assert (cold.std_V > 3.0 * inside.std_V).mean() > 0.99
    strong = np.abs(plain.current_A) > 4.0
    assert (loaded.std_V[strong] > 2.0 * inside.std_V[strong]).mean() > 0.9


def test_the_covariance_is_of_the_free_coefficients(network: LocalModelNetwork, known: Uncertainty) -> None:
    expansion = known.parameters.expansion
    assert expansion is not None and expansion.size == len(known.parameters.factor)
    assert known.parameters.theta_factor.shape[0] == network.theta.size
    # What the network's parameters are follows from them: its outermost knots are not free.
    theta = network.theta
    free = np.concatenate([theta[list(places), column] for column, places in enumerate(expansion.places)])
    np.testing.assert_allclose(expansion.matrix() @ free, theta.ravel(), atol=1e-9)


def test_samples_are_those_of_the_runs_and_the_rims_have_none(network: LocalModelNetwork, known: Uncertainty) -> None:
    assert known.samples.sum() == pytest.approx(6000, abs=10)
    assert known.samples[0] == known.samples[-1] == 0.0 and known.thin[0] and known.thin[-1]
    assert (known.effective_samples <= known.samples * (1 + 1e-9)).all()
    assert network.n_models == len(known.samples)


def test_the_document_comes_back(network: LocalModelNetwork, known: Uncertainty) -> None:
    document = json.loads(json.dumps(network.to_json(), allow_nan=False))
    again = uncertainty_of(LocalModelNetwork.from_json(document))
    assert again is not None and again.to_json() == known.to_json()
    band, former = (prediction_band(network, grid(9), SOC, each) for each in (again, known))
    np.testing.assert_array_equal(band.std_V, former.std_V)
