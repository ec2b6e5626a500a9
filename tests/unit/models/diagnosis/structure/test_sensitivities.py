"""Derivatives of a free run, against differences of free runs."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.structure.sensitivities import sensitivities_V
from models.network.free_run import free_run_V
from models.network.structure import InputChannel, PartitionAxis, Structure
from tests.unit.models.diagnosis.hand_reference import steps_A
from tests.unit.models.hand_network import SCALING, everything, grid_run, network

STEP = 1e-6


@pytest.mark.parametrize("order", [0, 1, 2])
def test_they_are_the_slopes_of_the_free_run(order: int) -> None:
    model = everything(order)
    run = grid_run(steps_A(300), 25.0 + 5.0 * np.sin(np.arange(300) / 40.0))
    # A network with output feedback begins at the measured voltage.
    run = replace(run, voltage_V=np.full(300, 3.7), measured=np.ones(300, dtype=bool))
    index = np.array([5, 6, 40, 299])
    found = sensitivities_V(model, run, 0.5, index)
    assert found.shape == (4, model.theta.size)
    rng = np.random.default_rng(0)
    for number in rng.choice(model.theta.size, 12, replace=False):
        up, down = (model.theta.copy() for _ in range(2))
        up.flat[number] += STEP
        down.flat[number] -= STEP
        slope = free_run_V(replace(model, theta=up), run, 0.5) - free_run_V(replace(model, theta=down), run, 0.5)
        np.testing.assert_allclose(found[:, number], slope[index] / (2.0 * STEP), rtol=2e-5, atol=1e-6)


def test_blocks_of_a_long_run_join_without_a_seam() -> None:
    """The recursion goes on from one block of 4096 samples to the next."""
    structure = Structure(1, (InputChannel("current"),), (PartitionAxis("soc"),), 1.0)
    model = network(structure, np.array([[0.999, 2e-5, 3.7e-3]]))
    n = 5000
    run = replace(grid_run(np.full(n, 1.0), 25.0, counted=False), voltage_V=np.full(n, 3.7))
    found = sensitivities_V(model, run, 0.5, np.array([4095, 4096, 4999]))
    # The offset's slope settles at the span over 1 - a, as 1 - a^k.
    low, high = SCALING["voltage"]
    expected = (high - low) * (1.0 - 0.999 ** np.array([4095.0, 4096.0, 4999.0])) / 0.001
    np.testing.assert_allclose(found[:, 2], expected, rtol=1e-9)
