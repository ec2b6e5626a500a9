"""Compare, where, which, add and watch over REST: a real service, real workers, the stored runs of a campaign."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from service_rig import Service

from tests.patience import LONG_S, PATIENCE_S, wait_for

# Short because it stays in the middle of the range; the model is the small one, which lacks much.
CAMPAIGN = {"bench": "sim", "name": "short", "duration_s": 4200.0, "soc": [0.4, 0.6], "structure": "minimal", "seed": 4}
BENCHES = """
[bench.sim]
simulate = { seed = 3 }
[bench.game]
simulate = { seed = 3, hidden_effect = "series_resistance" }
"""
pytestmark = pytest.mark.timeout(3 * LONG_S)  # the first test waits for the whole campaign

VERDICTS = {"missing", "nothing_missing", "ambiguous", "unknown_effect"}


@dataclass(frozen=True)
class Rest:
    service: Service

    def post(self, address: str, body: object) -> httpx.Response:
        return httpx.post(f"{self.service.url}/api/v1{address}", json=body, timeout=PATIENCE_S)

    def get(self, address: str) -> httpx.Response:
        return httpx.get(f"{self.service.url}/api/v1{address}", timeout=PATIENCE_S)

    def job(self, answer: httpx.Response) -> dict[str, Any]:
        """Wait for the job of an answer and give its result."""
        assert answer.status_code == 202, answer.text
        return self.service.client.wait_job(answer.json()["id"], timeout_s=LONG_S)["result"]


@pytest.fixture(scope="module")
def rest(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rest]:
    service = Service(tmp_path_factory.mktemp("diagnosis"), BENCHES)
    yield Rest(service)
    assert service.end() == (0, "")


@pytest.fixture(scope="module")
def campaign(rest: Rest) -> dict[str, Any]:
    started = rest.service.client.start_campaign(CAMPAIGN)
    ended = rest.service.client.wait_campaign(started["id"], timeout_s=LONG_S)
    assert ended["state"] == "completed", ended["message"]
    result = ended["result"]
    train, validate = (run["run_id"] for run in result["runs"])
    return {"model": result["model_id"], "train": train, "validate": validate, "comparison": result["comparison_id"]}


@pytest.fixture(scope="module")
def child(rest: Rest, campaign: dict[str, Any]) -> dict[str, Any]:
    return rest.service.client.add_effect(campaign["model"], "relaxation", timeout_s=LONG_S)


def refusal(answer: httpx.Response) -> tuple[int, list[Any] | None, str]:
    error = answer.json()["error"]
    return answer.status_code, error["where"], error["message"]


def test_the_catalogue_says_how_to_recognise_an_effect(rest: Rest) -> None:
    effects = {each["name"]: each for each in rest.service.client.effects()}
    assert len(effects) >= 19
    hysteresis = effects["hysteresis"]
    assert {each["name"]: each["unit"] for each in hysteresis["parameters"]}["amplitude_V"] == "V"
    assert hysteresis["title"] and hysteresis["recognise"] and hysteresis["source"]
    assert effects["voltage_offset"]["absorbed"] is True and hysteresis["absorbed"] is False


def test_a_seal_is_opened_once_for_all(rest: Rest) -> None:
    seal = rest.service.client.bench("game")["seal"]
    assert seal["opened"] is None and len(seal["sha256"]) == 64
    assert refusal(rest.post("/benches/sim/seal/open", None))[0] == 404
    told = rest.service.client.open_seal("game")
    assert told["sha256"] == seal["sha256"] == hashlib.sha256(told["opened"]["contents"].encode()).hexdigest()
    assert told["opened"]["effect"] == "series_resistance" and told["opened"]["value"] > told["opened"]["before"]
    assert rest.service.client.open_seal("game") == told == rest.service.client.bench("game")["seal"]

    def told_in_events() -> list[dict[str, Any]]:
        return [each for each in rest.service.client.events() if each["code"] == "seal_opened"]

    events = wait_for(told_in_events, "the seal among the events")
    assert len(events) == 1 and "series_resistance" in events[0]["text"]


def test_a_comparison_tells_noise_from_what_hangs_together(rest: Rest, campaign: dict[str, Any]) -> None:
    result = rest.service.client.comparison(campaign["comparison"])["result"]
    assert 0.9 < result["whiteness"]["white_mV"] < result["overall"]["rmse_mV"]  # the simulated sensor has 1 mV
    assert result["whiteness"]["text"] and result["corrections"] == []
    assert all(region["share_of_squared_error"] > region["share_of_time"] for region in result["regions"])
    assert result["inside_training"]["n_samples"] <= result["overall"]["n_samples"]


def test_where_a_comparison_is_off(rest: Rest, campaign: dict[str, Any]) -> None:
    where = rest.service.client.comparison_where(campaign["comparison"])
    assert {each["variable"] for each in where["profiles"]} >= {"soc", "since_step_s"}
    assert {each["y"]["variable"] for each in where["maps"]} >= {"current_A"}
    for found in where["maps"]:
        assert len(found["rmse_mV"]) == len(found["y"]["edges"]) - 1
        assert {len(row) for row in found["rmse_mV"]} == {len(found["x"]["edges"]) - 1}
    for region in where["regions"]:
        assert region["share_of_squared_error"] > region["share_of_time"] and region["text"]
    assert rest.get("/comparisons/none/where").status_code == 404


def test_a_diagnosis_is_made_in_a_job_and_kept(rest: Rest, campaign: dict[str, Any]) -> None:
    body = {"model_id": campaign["model"], "run_ids": [campaign["validate"]], "mode": "structure"}
    result = rest.job(rest.post("/diagnoses", body))
    record = rest.get(f"/diagnoses/{result['diagnosis_id']}").json()
    assert record["run_ids"] == [campaign["validate"]] and record["mode"] == "structure"
    assert record["train_run_ids"] == [campaign["train"]]  # those of the model, where nobody names any
    found = record["result"]
    assert found["verdict"] == result["verdict"] in VERDICTS and found["mode"] == "structure"
    assert found["noise_floor_mV"] == pytest.approx(1.0, rel=0.3)  # as the simulated sensor has it
    for finding in found["findings"]:
        assert finding["effect"] in {each["name"] for each in rest.get("/effects").json()["effects"]}
        assert finding["error_before_mV"] > 0 and 0 <= finding["confidence"] <= 1 and finding["explanation"]
    listed = rest.get(f"/diagnoses?model_id={campaign['model']}").json()["diagnoses"]
    assert listed[0] == record and rest.get("/diagnoses?model_id=none").json()["diagnoses"] == []


def test_what_cannot_be_diagnosed_is_said(rest: Rest, campaign: dict[str, Any]) -> None:
    body = {"model_id": campaign["model"], "run_ids": [campaign["validate"]]}
    assert refusal(rest.post("/diagnoses", body | {"model_id": "none"}))[0] == 404
    assert refusal(rest.post("/diagnoses", body | {"run_ids": ["none"]}))[0] == 404
    assert refusal(rest.post("/diagnoses", body | {"run_ids": []}))[:2] == (422, ["run_ids"])
    assert refusal(rest.post("/diagnoses", body | {"mode": "guess"}))[:2] == (422, ["mode"])
    assert refusal(rest.post("/diagnoses", body | {"initial_soc": 1.5}))[:2] == (422, ["initial_soc"])
    assert refusal(rest.post("/diagnoses", body | {"extra": 1}))[0] == 422
    twice = body | {"run_ids": [campaign["validate"]] * 2}
    assert refusal(rest.post("/diagnoses", twice))[:2] == (422, ["run_ids"])
    both = body | {"train_run_ids": [campaign["validate"]]}
    assert refusal(rest.post("/diagnoses", both))[:2] == (422, ["train_run_ids"])
    assert rest.get("/diagnoses/none").status_code == 404


def test_an_experiment_needs_rivals_and_a_bench(rest: Rest, campaign: dict[str, Any]) -> None:
    assert refusal(rest.post("/diagnoses/none/experiment", {"bench": "sim"}))[0] == 404
    body = {"model_id": campaign["model"], "run_ids": [campaign["validate"]]}
    made = rest.service.client.diagnose(body["model_id"], body["run_ids"], timeout_s=LONG_S)["id"]
    assert refusal(rest.post(f"/diagnoses/{made}/experiment", {"bench": "none"}))[0] == 404
    assert refusal(rest.post(f"/diagnoses/{made}/experiment", {"bench": "sim", "initial_soc": 2}))[0] == 422
    answer = rest.post(f"/diagnoses/{made}/experiment", {"bench": "sim"})
    if rest.get(f"/diagnoses/{made}").json()["result"]["next_experiment"] is None:
        assert refusal(answer)[0] == 409 and "rivals" in refusal(answer)[2]
    else:
        assert answer.status_code == 202 and answer.json()["kind"] == "experiment"
        cancelled = rest.post(f"/jobs/{answer.json()['id']}/cancel", {})
        assert cancelled.json()["state"] == "failed"


def test_an_added_effect_makes_a_child_with_both_errors(
    rest: Rest, campaign: dict[str, Any], child: dict[str, Any]
) -> None:
    assert set(child) >= {"effect", "model", "parent", "error_before_mV", "error_after_mV", "parameters"}
    assert (child["effect"], child["parent"]) == ("relaxation", campaign["model"])
    assert child["parameters"]["time_constant_s"]["unit"] == "s"
    model = rest.service.client.model(child["model"])
    assert model["parent_id"] == campaign["model"] and "relaxation" in model["name"]
    # Without names the runs of the parent: its own train, the other one of its campaign judges.
    assert [run["run_id"] for run in model["train"]] == [campaign["train"]]
    assert [run["run_id"] for run in model["validate"]] == [campaign["validate"]]
    for model_id, key in ((campaign["model"], "error_before_mV"), (child["model"], "error_after_mV")):
        compared = rest.service.client.compare(model_id, [campaign["validate"]])
        assert compared["result"]["overall"]["rmse_mV"] == pytest.approx(child[key], rel=1e-6)


def test_the_chain_names_siblings_and_their_errors(rest: Rest, campaign: dict[str, Any], child: dict[str, Any]) -> None:
    sibling = rest.job(rest.post(f"/models/{campaign['model']}/effects", {"effect": "charge_transfer"}))
    chain = rest.get(f"/models/{child['model']}/chain").json()
    assert chain["chain"] == [campaign["model"], child["model"]]
    assert chain["noise_floor_mV"] == pytest.approx(1.0, rel=0.3)
    models = {each["id"]: each for each in chain["models"]}
    assert list(models) == [campaign["model"], child["model"], sibling["model"]]
    assert [each["in_chain"] for each in chain["models"]] == [True, True, False]
    assert [each["effect"] for each in chain["models"]] == [None, "relaxation", "charge_transfer"]
    held_out = {key: each["held_out"] for key, each in models.items()}
    assert held_out[campaign["model"]]["rmse_mV"] == child["error_before_mV"]
    assert held_out[child["model"]]["rmse_mV"] == child["error_after_mV"]
    assert {tuple(each["run_ids"]) for each in held_out.values()} == {(campaign["validate"],)}
    assert rest.service.client.model_chain(campaign["model"])["chain"] == [campaign["model"]]
    assert rest.get("/models/none/chain").status_code == 404


def test_what_cannot_be_added_is_said(rest: Rest, campaign: dict[str, Any], child: dict[str, Any]) -> None:
    address = f"/models/{campaign['model']}/effects"
    status, where, message = refusal(rest.post(address, {"effect": "magic"}))
    assert (status, where) == (404, ["effect"]) and "hysteresis" in message
    assert refusal(rest.post("/models/none/effects", {"effect": "relaxation"}))[0] == 404
    assert refusal(rest.post(address, {}))[:2] == (422, ["effect"])
    both = {"effect": "relaxation", "train_run_ids": [campaign["train"]], "validate_run_ids": [campaign["train"]]}
    assert refusal(rest.post(address, both))[:2] == (422, ["validate_run_ids"])
    imported = rest.service.client.import_model(rest.service.client.model_document(campaign["model"]))
    status, where, _ = refusal(rest.post(f"/models/{imported['id']}/effects", {"effect": "relaxation"}))
    assert (status, where) == (422, ["train_run_ids"])
    assert rest.get(f"/models/{imported['id']}/chain").json()["models"][0]["held_out"] is None


def test_the_schema_of_the_interface_names_them(rest: Rest) -> None:
    paths = httpx.get(f"{rest.service.url}/api/v1/openapi.json").json()["paths"]
    for path in ("/diagnoses", "/effects", "/models/{model_id}/effects", "/models/{model_id}/chain"):
        assert f"/api/v1{path}" in paths


def test_the_page_documents_every_address(rest: Rest) -> None:
    written = (Path(__file__).parents[2] / "docs" / "rest.md").read_text(encoding="utf-8")
    for path in ("/diagnoses", "/comparisons/{comparison_id}/where", "/effects", "/models/{model_id}/chain"):
        assert f"`GET /api/v1{path}`" in written
    assert "`POST /api/v1/models/{model_id}/effects`" in written and "`POST /api/v1/diagnoses`" in written


def test_a_refit_is_one_more_version(rest: Rest, campaign: dict[str, Any]) -> None:
    runs = [campaign["validate"]], [campaign["train"]]
    made = rest.service.client.refit(campaign["model"], runs[0], validate_run_ids=runs[1], timeout_s=LONG_S)
    assert made["parent"] == campaign["model"] and made["effect"] is None
    assert made["error_before_mV"] > 0 and made["error_after_mV"] > 0
    chain = rest.service.client.model_chain(made["model"])
    assert chain["chain"] == [campaign["model"], made["model"]]
    assert chain["models"][-1]["held_out"]["rmse_mV"] == made["error_after_mV"]
    judged = rest.service.client.compare(made["model"], runs[1])["result"]["overall"]["rmse_mV"]
    assert judged == pytest.approx(made["error_after_mV"], rel=1e-6)
    body = {"train_run_ids": runs[0], "validate_run_ids": runs[0]}
    assert refusal(rest.post(f"/models/{campaign['model']}/refit", body))[:2] == (422, ["validate_run_ids"])
    assert refusal(rest.post(f"/models/{campaign['model']}/refit", {}))[:2] == (422, ["train_run_ids"])
