import numpy as np
import pytest

from models.baselines import CellModel, fit_enhanced_self_correcting, fit_equivalent_circuit
from models.comparison.figures import compare
from models.comparison.simulated_runs import simulate_runs
from models.data.resampling import to_grid
from models.network.free_run import free_run_V
from tests.unit.models.baselines import circuits
from tests.unit.models.hand_network import everything, grid_run

MODELS = {
    "1RC": lambda runs: fit_equivalent_circuit(runs, capacity_Ah=circuits.CAPACITY_AH, n_branches=1, dt_s=1.0),
    "ESC": lambda runs: fit_enhanced_self_correcting(runs, capacity_Ah=circuits.CAPACITY_AH, dt_s=1.0),
}


@pytest.mark.parametrize("fit", MODELS.values(), ids=MODELS)
def test_any_model_of_a_cell_is_compared(fit) -> None:
    model: CellModel = fit([circuits.run(3000, seed=1)])
    runs = [circuits.run(2000, seed=2), circuits.run(1500, seed=3)]
    found = compare(model, runs, [0.6, 0.6])
    simulated = [free_run_V(model, to_grid(run, model.dt_s), 0.6) for run in runs]
    error = np.concatenate([v - run.voltage_V for v, run in zip(simulated, runs, strict=True)])
    assert found["overall"]["rmse_mV"] == pytest.approx(1e3 * np.sqrt(np.mean(error**2)))
    assert len(found["runs"]) == 2 and found["where"]
    assert len(simulate_runs(model, runs, [0.6, 0.6])[0].residual_V) == 2000


def test_a_network_is_a_model_of_a_cell() -> None:
    network: CellModel = everything(1)
    assert network.name == "network (custom)"
    assert network.dt_s == 1.0
    assert len(free_run_V(network, grid_run(np.zeros(300), 20.0), 0.5)) == 300
