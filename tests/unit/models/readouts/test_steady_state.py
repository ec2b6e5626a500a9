from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.network.free_run import free_run_V
from models.network.partition import Partition
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.readouts.steady_state import (
    OperatingPoints,
    current_axis,
    outside_reservations,
    settled_voltage,
    soc_axis,
    standard_deviation,
    temperature_axis,
)
from models.uncertainty.spread import LocalFactor
from tests.unit.models import hand_network

SOC_LINE = Structure(
    2,
    (InputChannel("soc", delay=1), InputChannel("current", order=1)),
    (PartitionAxis("soc", initial=1),),
    hand_network.DT_S,
)


def one_model() -> hand_network.LocalModelNetwork:
    """V = 0.8 V(k-1) + 0.05 V(k-2) + 0.15 (3.4 + 0.6 soc) + 0.003 I(k) + 0.0015 I(k-1)."""
    return hand_network.network(SOC_LINE, np.array([[0.8, 0.05, 0.09, 0.003, 0.0015, 0.51]]))


def test_a_single_local_model_settles_to_its_closed_form() -> None:
    points = OperatingPoints.grid([0.2, 0.5, 0.9], [[-4.0], [0.0], [3.0]], 1.0, 25.0)
    expected = 3.4 + 0.6 * points.soc + 0.0045 / 0.15 * points.current_A
    np.testing.assert_allclose(settled_voltage(one_model(), points).voltage_V, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kernel", ["gaussian", "triangular"])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_settled_voltage_is_where_a_long_free_run_ends(order: int, kernel: str) -> None:
    network = hand_network.everything(order, kernel)
    for current_A, direction in ((3.0, 1.0), (-4.0, -1.0)):
        run = hand_network.grid_run(np.full(6000, current_A), 18.0, counted=False)
        settled = settled_voltage(network, OperatingPoints.grid(0.37, current_A, direction, 18.0)).voltage_V[0]
        assert free_run_V(network, run, 0.37)[-1] == pytest.approx(settled, abs=1e-6)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_gradient_matches_finite_differences(order: int) -> None:
    network = hand_network.everything(order)
    points = OperatingPoints.grid([0.2, 0.8], [[-5.0], [2.0]], 1.0, 12.0)
    gradient = settled_voltage(network, points).gradient_V
    rng = np.random.default_rng(0)
    for index in rng.choice(network.theta.size, 40, replace=False):
        step = np.zeros(network.theta.size)
        step[index] = 1e-6
        up, down = (
            settled_voltage(replace(network, theta=network.theta + s * step.reshape(network.theta.shape)), points)
            for s in (1.0, -1.0)
        )
        numeric = (up.voltage_V - down.voltage_V) / 2e-6
        np.testing.assert_allclose(gradient[:, index], numeric, rtol=1e-5, atol=1e-7)


def test_what_does_not_settle_is_not_a_number() -> None:
    structure = replace(SOC_LINE, output_order=1)
    growing = hand_network.network(structure, np.array([[1.02, 0.09, 0.003, 0.0015, 0.51]]))
    assert np.isnan(settled_voltage(growing, OperatingPoints.grid(0.5, 1.0, 1.0, 25.0)).voltage_V).all()
    swinging = hand_network.network(SOC_LINE, np.array([[-0.3, 0.8, 0.09, 0.003, 0.0015, 0.51]]))
    assert np.isnan(settled_voltage(swinging, OperatingPoints.grid(0.5, 1.0, 1.0, 25.0)).voltage_V).all()


def test_bands_need_a_covariance_of_the_right_size() -> None:
    gradient = np.array([[1.0, 2.0], [0.0, 1.0]])
    factor = np.linalg.cholesky(np.array([[4.0, 1.0], [1.0, 9.0]]))
    np.testing.assert_allclose(standard_deviation(gradient, LocalFactor(factor)), np.sqrt([4 + 4 + 36, 9.0]))
    with pytest.raises(ModelError, match=r"shape \(3, 3\)"):
        standard_deviation(gradient, LocalFactor(np.eye(3)))


def test_axes_cover_the_trained_range() -> None:
    network = hand_network.everything(1)
    np.testing.assert_allclose(soc_axis(network)[[0, -1]], [0.07, 0.93])
    np.testing.assert_allclose(temperature_axis(network, 3), [4.0, 22.5, 41.0])
    np.testing.assert_allclose(current_axis(network, 2), [-7.0, -3.5, 2.5, 5.0])
    assert outside_reservations(network, {"soc": soc_axis(network), "current_A": current_axis(network)}) == []
    (text,) = outside_reservations(network, {"soc": np.array([0.0, 0.5])})
    assert "soc 0..0.5" in text and "0.07..0.93" in text


def test_a_network_without_temperature_gets_one_and_no_reservation() -> None:
    network = one_model()
    np.testing.assert_allclose(temperature_axis(network), [22.5])
    assert outside_reservations(network, {"temperature_degC": np.array([60.0])}) == []


def test_partition_is_asked_at_the_settled_signals() -> None:
    """Two local models over the current with different offsets: the blend follows the current."""
    structure = Structure(
        0, (InputChannel("current"),), (PartitionAxis("current", initial=2, k_sigma=0.3),), hand_network.DT_S
    )
    lower, upper = np.array([[0.0], [0.5]]), np.array([[0.5], [1.0]])
    partition = Partition(lower, upper, np.array([0.3]))
    network = hand_network.network(structure, np.array([[0.01, 3.5], [0.01, 3.9]]), partition)
    z = (np.array([-7.0, 5.0]) + 7.0) / 12.0
    weight = partition.validity(z[:, None])[:, 0]
    expected = weight * 3.5 + (1.0 - weight) * 3.9 + 0.01 * np.array([-7.0, 5.0])
    found = settled_voltage(network, OperatingPoints.grid(0.5, [-7.0, 5.0], 1.0, 25.0)).voltage_V
    np.testing.assert_allclose(found, expected, atol=1e-12)
