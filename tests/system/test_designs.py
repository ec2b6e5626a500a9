"""Designs over REST: a request with a stored model becomes a stored profile that a bench can play."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from service_rig import serving

from bench_service.client import BenchClient, ClientError
from tests.patience import LONG_S
from tests.unit.models.design.networks import resistive

REQUEST: dict[str, Any] = {
    "capacity_Ah": 2.0,
    "initial_soc": 0.5,
    "duration_s": 600,
    "limits": {"current_A": [-4, 2], "voltage_V": [2.5, 4.2], "soc": [0.1, 0.9]},
    "seed": 2,
}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BenchClient]:
    with serving(tmp_path_factory.mktemp("designs"), "[bench.sim]\nsimulate = { seed = 3 }\n") as service:
        yield service.client


@pytest.fixture(scope="module")
def model_id(client: BenchClient) -> str:
    return client.import_model(resistive().to_json())["id"]


def test_a_design_becomes_a_profile_within_its_limits(client: BenchClient, model_id: str, tmp_path: Path) -> None:
    made = client.design("best", REQUEST | {"model": model_id}, timeout_s=LONG_S)
    assert made["figures"]["n_samples"] == 60 and made["figures"]["log_det_information"] is not None
    profile = client.profile(made["profile_id"], points=True)
    assert profile["name"] == "best" and profile["time_s"][-1] == 600.0
    current = np.array(profile["current_A"])
    assert current.min() >= -4.0 - 1e-9 and current.max() <= 2.0 + 1e-9


def test_a_stored_profile_serves_as_load_cycle(client: BenchClient, model_id: str) -> None:
    cycle = client.upload_profile("cycle", [0, 30, 50, 100, 120], [-2.0, 1.0, -1.0, 1.5, 0.0])
    asked = REQUEST | {"model": model_id, "load_cycle": cycle["id"], "signal": "drive_cycle"}
    assert client.design("cycled", asked, timeout_s=LONG_S)["figures"]["duration_s"] == 600.0


def test_two_stored_models_are_told_apart(client: BenchClient, model_id: str) -> None:
    other = client.import_model(resistive(2).to_json())["id"]
    made = client.design(
        "apart", REQUEST | {"criterion": "discriminate", "rivals": [model_id, other]}, timeout_s=LONG_S
    )
    assert min(made["figures"]["separation"]) > 0.0
    assert made["figures"]["n_samples"] == 60


def test_effects_need_a_model_and_runs(client: BenchClient, model_id: str) -> None:
    asked = REQUEST | {"criterion": "discriminate", "rivals": ["hysteresis", "relaxation"], "model": model_id}
    with pytest.raises(ClientError, match="runs is missing"):
        client.design("apart", asked, timeout_s=LONG_S)


@pytest.mark.parametrize(
    ("changes", "status", "says"),
    [
        ({"model": "none"}, 404, "none"),
        ({"signal": "chirp"}, 422, "chirp"),
        ({"limits": {"current_A": [4, -4]}}, 422, "low end"),
        ({"runs": ["none"]}, 404, "none"),
        ({"rivals": ["hysteresis", "none"]}, 404, "none"),
    ],
)
def test_requests_that_cannot_be_are_refused_at_once(
    client: BenchClient, changes: dict, status: int, says: str
) -> None:
    with pytest.raises(ClientError, match=says) as refused:
        client.design("none", REQUEST | changes, timeout_s=LONG_S)
    assert refused.value.status == status


def test_what_only_the_design_can_tell_is_told_by_the_job(client: BenchClient, model_id: str) -> None:
    narrow = REQUEST | {"model": model_id, "limits": {"current_A": [-4, 2], "voltage_V": [3.0, 3.1]}}
    with pytest.raises(ClientError, match="voltage_V is 3..3.1 V"):
        client.design("narrow", narrow, timeout_s=LONG_S)
