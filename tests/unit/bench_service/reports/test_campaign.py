"""The report of a campaign: all that it came to, also where it failed on its way."""

from typing import Any

from bench_service.campaign import stages
from bench_service.reports.campaign import STAGES, campaign_report
from bench_service.reports.document import Heading, render
from bench_service.store.records import CampaignRecord
from tests.unit.bench_service.reports.test_diagnosis import answer

METRICS = {
    "rmse_mV": 2.0,
    "mae_mV": 1.5,
    "p95_mV": 3.0,
    "max_mV": 9.0,
    "bias_mV": -0.5,
    "nrmse": 0.01,
    "n_samples": 100,
}
RESULT = {
    "runs": [{"run_id": "r1", "role": "train", "n_samples": 100, "missed_ticks": 1}],
    "samples": 100,
    "missed_ticks": 1,
    "seconds": 65.0,
    "train": METRICS,
    "validation": METRICS,
    "sensor_noise_mV": 1.0,
    "model_chain": [
        {"model": "m1", "effect": None, "validation_rmse_mV": 10.0},
        {"model": "m2", "effect": "capacity", "validation_rmse_mV": 2.0,
         "parameters": {"capacity_Ah": {"value": 2.3, "std": 0.01, "unit": "Ah"}}},
    ],
    "soc": {"rmse": 0.004, "max_error": 0.01, "end_error": 0.001, "converged_after_s": 0.0, "coverage_95": 0.9,
            "started_off_by": -0.2},
    "diagnosis": answer(),
}  # fmt: skip


def page(result: dict[str, Any] | None, **changes: Any) -> str:
    stage = {"name": "design", "state": "done", "detail": "4 profiles", "seconds": 0.06}
    fields: dict[str, Any] = {"id": "c1", "name": "a campaign", "bench": "sim", "state": "completed", "stage": "done",
                              "stages": (stage,), "request": {}, "result": result, "created_utc": "x",
                              "code_version": "1"}  # fmt: skip
    record = CampaignRecord(**(fields | changes))
    return render(
        campaign_report(Heading("Campaign", record.name), record, {"r1": "first (r1)", "m1": "m (m1)"})
    ).decode()


def test_all_that_it_came_to_is_told() -> None:
    text = page(RESULT)
    for said in ("first (r1)", "m (m1)", "with: Capacity", "capacity 2.300 ± 0.010 Ah", "0.50 mV",
                 "below 3 % all the time",
                 "Verdict: an effect was found.", "20 points", "0.06 s", "Design of the profiles"):  # fmt: skip
        assert said in text, said


def test_one_that_failed_is_told_as_far_as_it_came() -> None:
    text = page(None, state="failed", message="no voltage_V at all")
    assert "Failed: no voltage at all." in text and "<h2>Errors" not in text


def test_every_stage_has_words() -> None:
    assert set(stages._SHARES) == set(STAGES)  # noqa: SLF001
