"""A model that learns from run to run: capacity and local models follow the cell, and nothing worse is kept."""

from dataclasses import replace

import numpy as np
import pytest

from models.comparison.placed_runs import free_run_metrics
from models.comparison.start import Start
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.network.lineage import chain, version_of
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.fit import fit_network
from models.pipeline.learning.capacity import capacity_from
from models.pipeline.learning.learn import SETTINGS, learn_from_run, learn_from_runs
from tests.unit.models import synthetic

N, NOISE_V, START = 2400, 1e-3, 0.6


def aged(seed: int, share: float, more: float, swing_A: float = 3.0) -> TimeSeries:
    """A run of the cell with a share of its capacity and so much more resistance."""
    rng = np.random.default_rng(seed)
    current = synthetic.excitation_A(N, rng, 3.0)
    current += swing_A * np.sin(np.arange(N) / N * 4.0 * np.pi) - current.mean()
    current[0] = 0.0
    counted = np.concatenate([[0.0], np.cumsum(current[1:])]) / (3600.0 * synthetic.CAPACITY_AH)
    pole, slow = np.exp(-1.0 / synthetic.TAU_S), np.zeros(N)
    for k in range(1, N):
        slow[k] = pole * slow[k - 1] + (1.0 - pole) * synthetic.R1_OHM * current[k]
    voltage = synthetic.ocv_V(START + counted / share) + more * (synthetic.R0_OHM * current + slow)
    voltage += NOISE_V * rng.standard_normal(N)
    told = np.where(np.arange(N) == 0, START, np.nan)
    return TimeSeries(np.arange(N) * 1.0, current, voltage, np.full(N, 25.0), None, told, f"aged {seed}")


@pytest.fixture(scope="module")
def new() -> LocalModelNetwork:
    train = [aged(1, 1.0, 1.0, 5.0), aged(2, 1.0, 1.0, 5.0)]
    return fit_network(train, capacity_Ah=synthetic.CAPACITY_AH, structure="minimal").network


def error_mV(network: LocalModelNetwork, run: TimeSeries) -> float:
    return free_run_metrics(network, [run], [START])["rmse_mV"]


def test_each_run_makes_a_version_and_the_chain_follows_the_cell(new: LocalModelNetwork) -> None:
    ages = [(0.98**k, 1.03**k) for k in (1, 2, 3)]
    found = learn_from_runs(new, [aged(10 + k, *age) for k, age in enumerate(ages)], [START] * 3)
    judged = [aged(20 + k, *age) for k, age in enumerate(ages)]
    versions = [error_mV(each.network, run) for each, run in zip(found, judged, strict=True)]
    old = [error_mV(new, run) for run in judged]
    assert max(versions) < 1.7 < 2.5 < old[0] < old[1] < old[2]
    assert all(each.learned and each.after["rmse_mV"] < each.before["rmse_mV"] for each in found)
    assert found[-1].capacity.value_Ah == pytest.approx(synthetic.CAPACITY_AH * ages[-1][0], rel=0.01)
    assert [version_of(each.network).number for each in found] == [2, 3, 4]  # pyright: ignore
    models = [new, *(each.network for each in found)]
    assert [each is model for each, model in zip(chain(models[-1], models), models[::-1], strict=True)] == [True] * 4
    assert LocalModelNetwork.from_json(found[-1].network.to_json()).to_json() == found[-1].network.to_json()


def test_a_run_that_says_nothing_new_moves_little(new: LocalModelNetwork) -> None:
    found = learn_from_run(new, aged(30, 1.0, 1.0), START)
    assert error_mV(found.network, aged(31, 1.0, 1.0)) < 1.05 * error_mV(new, aged(31, 1.0, 1.0))
    assert found.network.cell.capacity_Ah == pytest.approx(new.cell.capacity_Ah, rel=0.003)


def test_a_run_that_cannot_be_simulated_better_is_not_learned(
    new: LocalModelNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "models.pipeline.learning.learn._updated", lambda network, *_: replace(network, theta=0.9 * network.theta)
    )
    found = learn_from_run(new, aged(40, 1.0, 1.0), START)
    assert not found.learned and found.network is new and "stays as it was" in found.reason
    assert found.to_json()["error_after_mV"] == found.to_json()["error_before_mV"]


def test_a_run_under_rest_tells_no_capacity(new: LocalModelNetwork) -> None:
    run = replace(
        aged(50, 0.9, 1.0), current_A=np.zeros(N), voltage_V=np.full(N, float(synthetic.ocv_V(np.array(START))))
    )
    found = capacity_from(new, to_grid(run, 1.0), Start(START), SETTINGS[0])
    assert found.std_Ah == 0.0 and found.value_Ah == new.cell.capacity_Ah


def test_the_capacity_is_as_sure_as_it_says(new: LocalModelNetwork) -> None:
    """The model's own curve is off by some tenths of a millivolt: the charge alone would be told far too surely."""
    found = [capacity_from(new, to_grid(aged(60 + k, 0.97, 1.03), 1.0), Start(START), SETTINGS[0]) for k in range(4)]
    off_Ah = np.array([each.value_Ah for each in found]) - 0.97 * synthetic.CAPACITY_AH
    std_Ah = np.array([each.std_Ah for each in found])
    assert (std_Ah > 0.0).all() and (std_Ah < 0.02 * synthetic.CAPACITY_AH).all()
    assert np.sqrt(np.mean((off_Ah / std_Ah) ** 2)) < 2.0
