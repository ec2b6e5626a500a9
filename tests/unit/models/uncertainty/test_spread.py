"""Variances from the parts of the factor that count, against the whole covariance."""

import numpy as np
import pytest

from models.diagnosis.structure.sensitivities import sensitivities_V
from models.readouts.steady_state import OperatingPoints, settled_voltage, standard_deviation
from models.uncertainty.spread import LocalFactor, blended_variance, gradient_variance
from tests.unit.models.hand_network import everything, grid_run, hats
from tests.unit.models.network.test_free_run import measured_run


def whole(gradient: np.ndarray, factor: np.ndarray) -> np.ndarray:
    return np.einsum("kp,pq,kq->k", gradient, factor @ factor.T, gradient)


# Fewer columns than parameters, as where penalties leave few directions, and as many.
@pytest.mark.parametrize("columns", [10, 60])
@pytest.mark.parametrize("n", [7, 5000])
def test_hats_need_their_own_part_of_the_factor(n: int, columns: int) -> None:
    network, rng = hats(), np.random.default_rng(1)
    factor = rng.standard_normal((network.theta.size, columns))
    run = measured_run(n, largest_A=9.0)
    data = network.dataset([run], [0.5])
    validity = network.partition.validity(data.z)
    gradient = np.einsum("km,kp->kmp", validity, data.u).reshape(n, -1)
    found = LocalFactor(factor)
    np.testing.assert_allclose(blended_variance(found, validity, data.u), whole(gradient, factor), rtol=1e-9)
    # What was worked out for the first call serves the second.
    np.testing.assert_allclose(blended_variance(found, validity, data.u), whole(gradient, factor), rtol=1e-9)
    np.testing.assert_allclose(gradient_variance(LocalFactor(factor), gradient), whole(gradient, factor), rtol=1e-9)


def test_local_models_that_all_count_need_all_of_it() -> None:
    network, rng = everything(0), np.random.default_rng(2)
    factor = rng.standard_normal((network.theta.size, network.theta.size))
    data = network.dataset([measured_run(300)], [0.5])
    validity = network.partition.validity(data.z)
    gradient = np.einsum("km,kp->kmp", validity, data.u).reshape(300, -1)
    np.testing.assert_allclose(
        blended_variance(LocalFactor(factor), validity, data.u), whole(gradient, factor), rtol=1e-9
    )


def test_what_depends_on_no_parameter_has_no_variance() -> None:
    assert gradient_variance(LocalFactor(np.eye(40)), np.zeros((3, 40))).tolist() == [0.0, 0.0, 0.0]


def test_read_outs_of_hats_have_the_spread_of_their_gradient() -> None:
    network, rng = hats("surface_soc:0.05/400/3500"), np.random.default_rng(3)
    factor = rng.standard_normal((network.theta.size, 20))
    points = OperatingPoints.grid(np.linspace(0.0, 1.0, 41), [[-3.0], [0.0], [2.0]], 1.0, 20.0)
    gradient = settled_voltage(network, points).gradient_V
    expected = np.sqrt(whole(gradient, factor))
    np.testing.assert_allclose(standard_deviation(gradient, LocalFactor(factor)), expected, rtol=1e-9)


def test_sensitivities_of_hats_are_those_of_the_voltage() -> None:
    network = hats()
    run = grid_run(np.repeat([1.0, -2.0, 3.0], 40), 20.0)
    index = np.array([5, 60, 119])
    rows = sensitivities_V(network, run, 0.4, index)
    data = network.dataset([run], [0.4])
    voltage = network.to_volts(np.sum(rows * network.theta.ravel(), axis=1) / network.voltage_span_V)
    np.testing.assert_allclose(
        voltage,
        network.to_volts(np.einsum("km,mp,kp->k", network.partition.validity(data.z), network.theta, data.u))[index],
    )
