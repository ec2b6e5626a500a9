"""What a worker answers of an observation: what the command prints, with the counted charge as the reference."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bench_service.jobs import observing
from bench_service.jobs.series import RunInput
from models.data.errors import ModelError
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.fit import fit_network
from tests.unit.models import synthetic

RUNS = [RunInput("11", 0.6), RunInput("12", 0.6)]


def silent(fraction: float, message: str = "") -> None:
    pass


@pytest.fixture(scope="module")
def simple() -> LocalModelNetwork:
    train = [synthetic.run(3000, seed=2, noise_V=1e-3)]
    return fit_network(train, capacity_Ah=synthetic.CAPACITY_AH, structure="minimal").network


@pytest.fixture
def observed(simple: LocalModelNetwork, monkeypatch: pytest.MonkeyPatch) -> Any:
    stored = {run.run_id: replace(synthetic.run(1500, seed=int(run.run_id)), soc_ref=None) for run in RUNS}
    monkeypatch.setattr(observing, "read_series", lambda _directory, runs: [stored[each.run_id] for each in runs])
    document = simple.to_json()
    return lambda soc=None, gain=None: observing.observe_runs(silent, Path(), document, RUNS, soc, gain)


def test_errors_count_from_the_charge_since_the_runs_start(observed: Any) -> None:
    found = observed()
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert found["gain"] == "kalman" and len(found["runs"]) == 2
    assert max(each["soc_rmse"] for each in found["runs"]) < 0.01
    off = observed(0.3)
    assert min(each["soc_max_error"] for each in off["runs"]) > 0.01 or off["runs"][0]["converged_after_s"] > 0.0


def test_the_gain_is_the_orders(observed: Any) -> None:
    steady, moment = observed(None, "steady"), observed(None, "kalman")
    assert steady["gain"] == "steady" and steady["runs"] != moment["runs"]
    assert max(each["soc_rmse"] for each in steady["runs"]) < 0.01
    with pytest.raises(ModelError, match="gain 'best' is not known; use one of kalman, steady"):
        observed(None, "best")
