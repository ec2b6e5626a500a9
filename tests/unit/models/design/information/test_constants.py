"""What a test tells of capacity, initial state of charge and time constants."""

import numpy as np
import pytest

from models.design.information.constants import constants_std
from models.network.structure import InputChannel, PartitionAxis, Structure
from tests.unit.models.design.networks import experiment
from tests.unit.models.hand_network import SCALING, network

SLOW = network(
    Structure(
        0,
        (InputChannel("soc", delay=1), InputChannel("current"), InputChannel("low_pass:300")),
        (PartitionAxis("soc", initial=1),),
        10.0,
    ),
    np.array([[0.5, 0.02, 0.03, 3.3]]),
    scaling=SCALING | {"low_pass:300": SCALING["current"]},
)
# All of the network but the constants is known.
SURE = np.eye(SLOW.theta.size) * 1e12


def test_a_start_is_known_as_well_as_the_slope_of_the_curve_tells() -> None:
    asked = experiment(network=SLOW, prior=SURE)
    found = constants_std(asked, np.zeros(100))
    # 100 samples, 0.5 V for the whole charge.
    assert found["initial_soc"] == pytest.approx(asked.noise_V / 0.5 / 10.0, rel=0.01)
    # At rest nothing is told of the others: what was known before remains.
    assert found["capacity"] == pytest.approx(0.05) and found["time_constant 300 s"] == pytest.approx(0.7)


def test_moving_the_charge_tells_the_capacity_and_pulses_the_time_constant() -> None:
    asked = experiment(network=SLOW, prior=SURE)
    pulses = constants_std(asked, np.tile(np.repeat([4.0, -4.0], 30), 5))
    away = constants_std(asked, np.full(300, -1.0))
    assert away["capacity"] < 0.6 * pulses["capacity"]
    assert pulses["time_constant 300 s"] < 0.5 * away["time_constant 300 s"] < 0.35


def test_what_is_not_known_of_the_network_leaves_the_constants_unsure() -> None:
    current = np.tile(np.repeat([4.0, -4.0], 30), 5)
    sure, unsure = (constants_std(experiment(network=SLOW, prior=p), current) for p in (SURE, None))
    assert all(unsure[name] >= sure[name] for name in sure) and unsure["initial_soc"] > 2.0 * sure["initial_soc"]
