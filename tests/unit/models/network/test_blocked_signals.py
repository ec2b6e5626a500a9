from typing import Any

import numpy as np
import pytest

from models.network.blocked_signals import make_signals
from models.network.compiled_network import flat_network, step_signals
from models.network.partition import hat_partition
from models.network.structure import InputChannel, PartitionAxis, Structure
from tests.unit.models import hand_network

_STEP: Any = step_signals
# Activations and exchange currents in turns: what is shared is not that of the neighbour. Nine plain low-passes.
SIGNALS = (
    "low_pass:3",
    "low_pass:30/3500",
    "charge_transfer:3/2500/20",
    "low_pass:300/7500",
    "hysteresis",
    "low_pass:10",
    "squared_current:60/3500",
    "charge_transfer:1/2500",
    "charge_transfer:3/3500",
    "surface_soc:0.05/400/3500",
    "surface_soc:0.02/900",
    "surface_soc:0.05/400/3500/30",
    "surface_soc:0.05/400/0/30",
    "behind_surface:0.05/400/3500/30",
    "behind_surface:3/20",
    "current",
    "scaled_current:3500",
    "relaxation:300",
    "hysteresis_state:40",
    "squared_current:20",
    "temperature",
    "temperature:5/30",
    "inverse_temperature",
)


@pytest.mark.parametrize("block", [1, 7, 250])
def test_blocks_hold_what_is_made_sample_by_sample(block: int) -> None:
    structure = Structure(0, tuple(InputChannel(name) for name in SIGNALS), (PartitionAxis("soc"),), 1.0, "hat")
    scaling = hand_network.SCALING | {name: (-2.0 - i, 3.0 + i) for i, name in enumerate(SIGNALS)}
    rows = np.zeros((2, structure.n_regressors))
    net = flat_network(hand_network.network(structure, rows, hat_partition(np.array([0.0, 1.0])), scaling))
    rng, n, count = np.random.default_rng(0), 500, len(net.form)
    current = np.repeat(rng.normal(0.0, 3.0, n // 5), 5) * (rng.random(n) > 0.2)
    degC, soc = rng.uniform(-10.0, 45.0, n), 0.5 + 1e-3 * np.cumsum(current)
    expected, plain, direction, before = np.empty((count, n)), np.zeros((count, 3)), -1.0, current[0]
    for k in range(n):
        if abs(current[k]) > net.rest_A:
            direction = float(np.sign(current[k]))
        now = np.empty(count)
        _STEP(net, plain, now, current[k], current[k] - before, soc[k], direction, degC[k])
        expected[:, k], before = now, current[k]
    found, filters, held = np.empty((count, n)), np.zeros((count, 3)), np.array([-1.0, current[0]])
    for first in range(0, n, block):
        part = slice(first, first + block)
        make_signals(net, filters, held, current[part], degC[part], soc[part], found[:, part])
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(filters, plain, rtol=1e-12, atol=1e-13)
    assert held.tolist() == [direction, current[-1]]
