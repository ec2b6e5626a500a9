"""An example of each record, for the schema of the REST API; a test holds them against it."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from bench_service.jobs.runner import Job
from bench_service.store.cells import CellRecord
from bench_service.store.diagnoses import DiagnosisRecord
from bench_service.store.records import (
    CampaignRecord,
    ComparisonRecord,
    EventRecord,
    ModelRecord,
    ProfileRecord,
    ProtocolRecord,
    RunRecord,
    RunReference,
    Stage,
)

_BEGAN, _ENDED = "2026-01-02T08:00:00.000000Z", "2026-01-02T12:10:00.000000Z"
_HASH = "09ba53c29b02a0bf7a846e01c3c7919fd8b54a819b059977fcc2229acb3e7006"
_RUN, _OTHER = "c49cf9aacc7a4c429a3d3ed190362b15", "96fcc6a2a8314562b18fdaaeee85d642"
_MODEL = "1e2ec3ed4605485598a87c24f86ab883"
_METRICS = {
    "rmse_mV": 1.04,
    "mae_mV": 0.83,
    "p95_mV": 2.04,
    "max_mV": 4.1,
    "bias_mV": -0.12,
    "nrmse": 0.0015,
    "n_samples": 15001,
}
_FINDING = {
    "effect": "capacity",
    "rank": 1,
    "error_before_mV": 10.5,
    "error_after_mV": 1.02,
    "explained_share": 0.99,
    "confidence": 0.98,
    "parameters": {"capacity_Ah": {"value": 2.333, "std": 0.01, "unit": "Ah"}},
    "confounded_with": [],
    "explanation": "Capacity has changed: capacity 2.33 +- 0.01 Ah.",
}


def record_examples() -> dict[str, dict[str, Any]]:
    """Return an example of each record, by the name of its schema."""
    made: tuple[Any, ...] = (_run(), _model(), _comparison(), _diagnosis(), _campaign(), *_small())
    return {type(each).__name__.removesuffix("Record"): asdict(each) for each in made}


def _run() -> RunRecord:
    return RunRecord(
        id=_RUN,
        number=2,
        name="first pulse",
        bench="sim",
        profile_id="ac74c487fe2943e7868632eb9ab56d8f",
        state="completed",
        dt_s=1.0,
        created_utc=_BEGAN,
        started_utc=_BEGAN,
        ended_utc=_ENDED,
        n_samples=15001,
        missed_ticks=0,
        sha256=_HASH,
        initial_soc=0.5,
        capacity_Ah=2.5,
        limits={"voltage_V": [2.5, 4.2], "current_A": [-10.0, 5.0], "soc": [0.0, 1.0]},
        code_version="0.1.0",
        elapsed_s=15000.4,
        operator="Bo",
        cell_id="C1",
    )


def _model() -> ModelRecord:
    return ModelRecord(
        id=_MODEL,
        name="left cell",
        structure="full",
        capacity_Ah=2.5,
        seed=1,
        parent_id=None,
        train=(RunReference(_RUN, _HASH),),
        validate=(),
        metrics={"train": _METRICS, "validation": None, "expected_rmse_mV": 1.01},
        sha256=_HASH,
        created_utc=_ENDED,
        campaign_id=None,
        code_version="0.1.0",
        cell_id="C1",
    )


def _comparison() -> ComparisonRecord:
    return ComparisonRecord(
        id="ec2815d355480ac2e0b7a1439e5860aa",
        model_id=_MODEL,
        runs=(RunReference(_RUN, _HASH),),
        initial_soc=None,
        result={"overall": _METRICS, "runs": [{"run": _RUN, **_METRICS}], "noise_floor_mV": 1.03},
        created_utc=_ENDED,
        campaign_id=None,
        code_version="0.1.0",
        cell_id="C1",
    )


def _diagnosis() -> DiagnosisRecord:
    return DiagnosisRecord(
        id="b71a05d300d54a88a6f489e7546db36f",
        model_id=_MODEL,
        runs=(RunReference(_OTHER, _HASH),),
        train=(RunReference(_RUN, _HASH),),
        mode="change",
        initial_soc=None,
        result={"verdict": "missing", "mode": "change", "findings": [_FINDING], "noise_floor_mV": 0.97},
        created_utc=_ENDED,
        campaign_id=None,
        code_version="0.1.0",
        cell_id="C1",
    )


def _campaign() -> CampaignRecord:
    stage: Stage = {"name": "design", "state": "done", "detail": "2 profiles of 15000 s", "seconds": 0.08}
    return CampaignRecord(
        id="78b0508e44054eb99912e1b0d859867f",
        name="first look",
        bench="sim",
        state="running",
        stage="run",
        stages=(stage,),
        progress=0.2,
        message="3.92 V",
        request={"bench": "sim", "duration_s": 15000.0},
        created_utc=_BEGAN,
        code_version="0.1.0",
    )


def _small() -> tuple[Any, ...]:
    return (
        EventRecord(
            id=7,
            created_utc=_BEGAN,
            severity="info",
            code="run_started",
            text="run 'first pulse' started: 15000 s, a sample each 1 s, from SoC 50.0%",
            bench="sim",
            run_id=_RUN,
            campaign_id=None,
            cell_id="C1",
        ),
        ProfileRecord("ac74c487fe2943e7868632eb9ab56d8f", "one pulse", _HASH, 3, 120.0, (0.0, 1.0),
                      (0.0167, 0.0, 0.0167), _BEGAN),
        ProtocolRecord(id="5d0f9a", name="pulse resistance", sha256=_HASH, n_steps=12, created_utc=_BEGAN),
        CellRecord(id="C1", label="left", owner="Ana", capacity_Ah=2.48, metadata={"batch": "7b"}, created_utc=_BEGAN),
        Job(id="037ffba8b41f4c6fbca73c261f495b23", kind="fit", state="running", progress=0.4, message="orders"),
    )  # fmt: skip
