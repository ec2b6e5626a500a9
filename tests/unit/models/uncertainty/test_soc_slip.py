"""What an uncertain state of charge does to a free run, on a curve of 0.7 V from empty to full."""

import numpy as np
import pytest

from models.network.structure import InputChannel, PartitionAxis, Structure
from models.uncertainty.soc_slip import slip_std_V
from tests.unit.models.hand_network import CAPACITY_AH, grid_run, network

MODEL = network(Structure(0, (InputChannel("soc", delay=1),), (PartitionAxis("soc"),), 1.0), np.array([[0.7, 3.4]]))
# 3.0 V over the whole curve: steeper than the mean one of 1.61 V over the trained 0.86.
KNEE = network(Structure(0, (InputChannel("soc", delay=1),), (PartitionAxis("soc"),), 1.0), np.array([[3.0, 2.0]]))
LARGE = np.full(3601, 1.0)


def test_at_rest_it_is_the_start_that_may_be_off() -> None:
    found = slip_std_V(MODEL, grid_run(np.zeros(3601), 25.0), 0.6, LARGE)
    assert found[1:] == pytest.approx(np.full(3600, 0.7 * 0.005), rel=1e-6)


def test_it_grows_with_the_charge_that_was_counted() -> None:
    run = grid_run(np.full(3601, -0.4 * CAPACITY_AH), 25.0)
    found = slip_std_V(MODEL, run, 0.6, LARGE)
    assert found[-1] == pytest.approx(0.7 * np.hypot(0.005, 0.01 * 0.4), rel=1e-3)


def test_a_model_that_is_known_to_a_millivolt_was_trained_on_good_states_of_charge() -> None:
    run = grid_run(np.full(3601, -0.4 * CAPACITY_AH), 25.0)
    found = slip_std_V(MODEL, run, 0.6, np.full(3601, 1e-3))
    assert np.median(found) == pytest.approx(0.5e-3)


def test_below_the_trained_states_of_charge_a_knee_may_fall_faster() -> None:
    run = grid_run(np.full(3601, -0.2 * CAPACITY_AH), 25.0)
    found = slip_std_V(KNEE, run, 0.2, np.full(3601, 1e-6))
    inside = 0.2 - 0.2 * np.arange(3601) / 3600.0 > 0.07
    assert found[inside].max() < 1e-5
    assert found[-1] == pytest.approx((3.0 - 1.61 / 0.86) * 0.07, rel=1e-2)
