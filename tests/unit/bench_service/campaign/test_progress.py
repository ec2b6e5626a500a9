"""The result of a campaign, out of what its stages have produced."""

import json
from typing import Any

import pytest

from bench_service.campaign.progress import Progress, Round, campaign_result
from bench_service.campaign.request import OBSERVER_OFFSET_SOC
from tests.unit.bench_service.api.route_rig import run_record

SOC = {"soc_rmse": 0.01, "soc_max_error": 0.03, "soc_end_error": 0.0, "converged_after_s": 60.0, "coverage_95": 0.97}


def ended(**changes: Any) -> Progress:
    """Two rounds and a validation."""
    runs = {
        "train": run_record(id="r1", n_samples=100, missed_ticks=1),
        "train 2": run_record(id="r2", n_samples=200, missed_ticks=None),
        "validate": run_record(id="r3", n_samples=None, missed_ticks=2),
    }
    rounds = [
        Round("train", "m1", {"train": {"rmse_mV": 4.0}}, None, {"rmse_mV": 6.0}),
        Round("train 2", "m2", {"train": {"rmse_mV": 3.0}}, {"seed": 1}, {"rmse_mV": 5.0}),
    ]
    comparison = {"overall": {"rmse_mV": 5.0}, "noise_floor_mV": 1.0}
    fields: dict[str, Any] = {
        "parts": {role: [run] for role, run in runs.items()},
        "rounds": rounds,
        "comparison_id": "k1",
        "comparison": comparison,
    }
    return Progress(**(fields | changes))


def test_the_last_model_has_learned_from_every_round() -> None:
    done = ended()
    assert done.model_id == "m2"
    assert done.learned == ["r1", "r2"]


def test_samples_and_missed_ticks_are_counted_over_all_runs() -> None:
    result = campaign_result(ended(), SOC)
    # What was never counted is nothing.
    assert (result["samples"], result["missed_ticks"]) == (300, 3)
    assert [(run["run_id"], run["role"]) for run in result["runs"]] == [
        ("r1", "train"),
        ("r2", "train 2"),
        ("r3", "validate"),
    ]


def test_figures_come_from_the_last_round_and_from_runs_that_no_fit_saw() -> None:
    result = campaign_result(ended(), SOC)
    assert result["train"] == {"rmse_mV": 3.0} and result["validation"] == {"rmse_mV": 5.0}
    assert (result["model_id"], result["comparison_id"], result["sensor_noise_mV"]) == ("m2", "k1", 1.0)
    assert result["soc"] == {
        "rmse": 0.01,
        "max_error": 0.03,
        "end_error": 0.0,
        "converged_after_s": 60.0,
        "coverage_95": 0.97,
        "started_off_by": OBSERVER_OFFSET_SOC,
    }
    assert [(each["round"], each["run_id"], each["design"]) for each in result["rounds"]] == [
        (1, "r1", None),
        (2, "r2", {"seed": 1}),
    ]
    assert [each["validation_rmse_mV"] for each in result["rounds"]] == [6.0, 5.0]


def test_versions_without_an_added_effect_are_the_rounds() -> None:
    chain = campaign_result(ended(), SOC)["model_chain"]
    assert [(each["model"], each["effect"], each["validation_rmse_mV"]) for each in chain] == [
        ("m1", None, 6.0),
        ("m2", None, 5.0),
    ]


def test_an_added_effect_stands_with_both_its_errors_on_the_same_runs() -> None:
    added = {
        "model": "m3",
        "effect": "hysteresis",
        "error_before_mV": 7.0,
        "error_after_mV": 2.0,
        "parameters": {"amplitude_V": {"value": 0.01}},
    }
    chain = campaign_result(ended(addition=added), SOC)["model_chain"]
    assert [each["validation_rmse_mV"] for each in chain] == [6.0, 7.0, 2.0]
    assert (chain[-1]["model"], chain[-1]["effect"]) == ("m3", "hysteresis")
    assert chain[-1]["parameters"] == {"amplitude_V": {"value": 0.01}}


def test_no_round_has_no_model() -> None:
    with pytest.raises(IndexError):
        _ = Progress().model_id


def test_what_a_failed_stage_did_not_reach_is_left_out() -> None:
    diagnosed = ended(diagnosis={"verdict": "missing"})
    whole = campaign_result(diagnosed, SOC)
    assert whole["diagnosis"] == {"verdict": "missing"} and "soc" in whole
    without_observer = campaign_result(diagnosed, None)
    assert without_observer == {key: value for key, value in whole.items() if key != "soc"}
    fitted = campaign_result(ended(comparison=None), None)
    assert fitted["model_id"] == "m2" and "validation" not in fitted and "model_chain" not in fitted
    played = campaign_result(Progress(parts=ended().parts), None)
    assert played["samples"] == 300 and "model_id" not in played


def test_what_a_later_service_goes_on_from_is_all_of_it() -> None:
    done = ended()
    again = Progress.from_json(json.loads(json.dumps(done.to_json())), done.parts)
    assert campaign_result(again, None) == campaign_result(done, None)
    assert again.learned == done.learned and done.to_json()["completed"] == len(done.runs)


def test_a_run_that_was_cut_off_counts_with_all_its_parts() -> None:
    parts = {"train": [run_record(id="a", n_samples=40, state="interrupted"), run_record(id="b", n_samples=60)]}
    done = ended(parts=ended().parts | parts)
    assert done.ids("train") == ["a", "b"] and done.runs["train"].id == "b" and done.longest("train").id == "b"
    assert {"a", "b"} <= {run["run_id"] for run in campaign_result(done, None)["runs"]}
    assert done.learned[:2] == ["a", "b"]
