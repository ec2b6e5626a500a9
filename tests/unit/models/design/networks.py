"""Small reference networks for designs, and what may be asked of them."""

from __future__ import annotations

import numpy as np

from models.design.information.experiment import Experiment
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from tests.unit.models.hand_network import network


def resistive(order: int = 1, dt_s: float = 10.0) -> LocalModelNetwork:
    """Three local models of 3.3 V and 0.5 V per unit of SoC, 20 mOhm at once and some more later."""
    inputs = (InputChannel("soc", delay=1), InputChannel("current", order=1))
    axes = (PartitionAxis("soc", initial=3, k_sigma=0.5),)
    poles = {0: [], 1: [0.8], 2: [1.1, -0.3]}[order]
    share = 1.0 - sum(poles)
    rows = []
    for i in range(3):
        rows.append([*poles, 0.5 * share, 0.02, (0.02 + 0.005 * i) * share, 3.3 * share])
    return network(Structure(order, inputs, axes, dt_s), np.array(rows))


def experiment(**changes: object) -> Experiment:
    fields: dict[str, object] = {"network": resistive(), "initial_soc": 0.5, "noise_V": 2e-3}
    return Experiment(**(fields | changes))  # type: ignore[arg-type]
