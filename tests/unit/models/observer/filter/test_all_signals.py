"""Every kind of signal, sample by sample in the observer and over a whole run in the network, agrees."""

import numpy as np
import pytest

from models.data.resampling import to_grid
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.partition import initial_partition
from models.network.regression import CellContext, find_scaling
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.observer import FuzzyObserver
from tests.unit.models import synthetic

INPUTS = (
    InputChannel("soc", delay=1),
    InputChannel("surface_soc:0.05/100/3000", delay=1),
    InputChannel("current", order=2),
    InputChannel("relaxation:200"),
    InputChannel("low_pass:30"),
    InputChannel("low_pass:30/2500"),
    InputChannel("squared_current:60/3000"),
    InputChannel("scaled_current:2500", order=1),
    InputChannel("charge_transfer:1.5/2500"),
    InputChannel("charge_transfer:1.5/0/20"),
    InputChannel("hysteresis_state:40"),
    InputChannel("temperature"),
    InputChannel("temperature:23/27"),
    InputChannel("inverse_temperature"),
)
AXES = (
    PartitionAxis("surface_soc:0.05/100/3000", initial=3),
    PartitionAxis("hysteresis", initial=2, k_sigma=0.25),
    PartitionAxis("current", initial=2),
)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_observer_without_voltage_equals_the_free_run(order: int) -> None:
    run = synthetic.run(800, seed=3)
    grid = to_grid(run, 1.0)
    cell = CellContext(synthetic.CAPACITY_AH)
    structure = Structure(order, INPUTS, AXES, 1.0)
    partition = initial_partition(structure.axes)
    theta = 0.1 * np.random.default_rng(4).normal(size=(partition.n_models, structure.n_regressors))
    theta[:, :order] = 0.3
    scaling = find_scaling(structure, [grid], [0.6], cell)
    network = LocalModelNetwork(structure, partition, theta, scaling, cell)
    simulated = free_run_V(network, grid, 0.6)
    # Where the observer has only one measured value to start from, the network takes that one too.
    voltage = np.full(len(run), np.nan)
    voltage[: max(order, 1)] = simulated[: max(order, 1)]
    observer = FuzzyObserver(network)
    state, _ = observer.step(observer.initial(0.6, 0.01), run.current_A[0], voltage[0], run.temperature_degC[0])
    state.x[0, :order] = (simulated[0] - scaling["voltage"][0]) / np.diff(scaling["voltage"])[0]
    _, rows = observer.replay(state, run.current_A[1:], np.full(len(run) - 1, np.nan), run.temperature_degC[1:])
    # The influence of the start has died out with 0.3^k (n = 1) or with poles below 0.72 (n = 2).
    np.testing.assert_allclose(rows[80:, 2], simulated[81:], atol=1e-8)
