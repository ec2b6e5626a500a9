"""Which operation answers with what; every operation stands in exactly one of these tables."""

from __future__ import annotations

_V1 = "/api/v1"


def _under(table: dict[str, str]) -> dict[str, str]:
    return {_placed(operation): value for operation, value in table.items()}


def _placed(operation: str) -> str:
    method, _, address = operation.partition(" ")
    return f"{method} {_V1}{address}"


# A record of the store, or a job.
RECORDED = _under(
    {
        "POST /cells": "Cell",
        "GET /cells/{cell_id}": "Cell",
        "PATCH /cells/{cell_id}": "Cell",
        "POST /cells/{cell_id}/retire": "Cell",
        "POST /cells/{cell_id}/reuse": "Cell",
        "POST /profiles": "Profile",
        "GET /profiles/{profile_id}": "Profile",
        "POST /protocols": "Protocol",
        "GET /protocols/{protocol_id}": "Protocol",
        "POST /runs": "Run",
        "GET /runs/{run_id}": "Run",
        "PATCH /runs/{run_id}": "Run",
        "POST /runs/{run_id}/stop": "Run",
        "GET /models/{model_id}": "Model",
        "POST /models/import": "Model",
        "POST /comparisons": "Comparison",
        "GET /comparisons/{comparison_id}": "Comparison",
        "GET /diagnoses/{diagnosis_id}": "Diagnosis",
        "POST /campaigns": "Campaign",
        "GET /campaigns/{campaign_id}": "Campaign",
        "POST /campaigns/{campaign_id}/resume": "Campaign",
        "POST /campaigns/{campaign_id}/stop": "Campaign",
    }
)
JOBS = {
    _placed(operation)
    for operation in (
        "POST /models",
        "GET /jobs/{job_id}",
        "POST /jobs/{job_id}/cancel",
        "POST /diagnoses",
        "POST /diagnoses/{diagnosis_id}/experiment",
        "POST /trends",
        "POST /models/{model_id}/effects",
        "POST /models/{model_id}/refit",
        "POST /models/{model_id}/learn",
        "POST /observations",
        "POST /designs",
        "POST /imports/{import_id}/look",
        "POST /imports/{import_id}/run",
    )
}
# A list under a key; None: of objects that are described in docs/rest.md.
LISTED: dict[str, tuple[str, str | None]] = {
    _placed(operation): value
    for operation, value in {
        "GET /benches": ("benches", None),
        "GET /cells": ("cells", "Cell"),
        "GET /cells/{cell_id}/events": ("events", "Event"),
        "GET /profiles": ("profiles", "Profile"),
        "GET /protocols": ("protocols", "Protocol"),
        "GET /runs": ("runs", "Run"),
        "GET /runs/{run_id}/steps": ("steps", None),
        "GET /runs/{run_id}/cycles": ("cycles", None),
        "GET /events": ("events", "Event"),
        "GET /runs/{run_id}/events": ("events", "Event"),
        "GET /formats": ("formats", None),
        "GET /models": ("models", "Model"),
        "GET /comparisons": ("comparisons", "Comparison"),
        "GET /diagnoses": ("diagnoses", "Diagnosis"),
        "GET /effects": ("effects", None),
        "GET /campaigns": ("campaigns", "Campaign"),
        "GET /standard-tests": ("standard_tests", None),
        "GET /mappings": ("mappings", None),
    }.items()
}
_BENCH = (
    "name url map state reason run_id capabilities capacity_Ah live lock_step chamber cell seal commissioning limits "
    "cell_type"
)
# An object of which these keys are always there.
KEYED = _under(
    {
        "GET /benches/{name}": _BENCH,
        "PUT /benches/{name}/cell": _BENCH,
        "POST /benches/{name}/acknowledge": _BENCH,
        "GET /benches/{name}/standing": "soc source",
        "POST /benches/{name}/stop": "state",
        "POST /benches/{name}/pause": "state",
        "POST /benches/{name}/skip": "state",
        "POST /benches/{name}/resume": "state",
        "GET /benches/{name}/stop-port": "url token",
        "POST /benches/{name}/seal/open": "sha256 opened",
        "GET /benches/{name}/queue": "bench held waiting hours",
        "POST /benches/{name}/queue/start": "bench held waiting hours",
        "GET /benches/{name}/commissioning": "bench record",
        "POST /benches/{name}/commission": "bench record sha256 state",
        "POST /protocols/preview": "name document steps limits duration_s",
        "GET /runs/{run_id}/samples": "columns n decimated",
        "GET /runs/{run_id}/observer": "columns n decimated",
        "GET /runs/{run_id}/incremental": "",
        "GET /runs/{run_id}/metadata": "bdf raw",
        "GET /models/{model_id}/document": "",
        "GET /models/{model_id}/tables": "thermal residuals usability local_models",
        "GET /models/{model_id}/chain": "model_id chain noise_floor_mV models",
        "GET /comparisons/{comparison_id}/series": "runs",
        "GET /comparisons/{comparison_id}/where": "",
        "POST /campaigns/estimate": "",
        "POST /imports": "id name n_bytes",
        "GET /imports/{import_id}": "id name n_bytes",
        "PUT /imports/{import_id}/content": "id name n_bytes",
        "DELETE /imports/{import_id}": "id state",
        "POST /mappings": "name",
    }
) | {"GET /healthz": "status version recorder storage benches sqlite_version"}
# No JSON: files, and what they may be.
BYTES: dict[str, tuple[str, ...]] = {
    _placed("GET /runs/{run_id}/export"): ("text/csv", "application/zip", "application/octet-stream"),
    _placed("GET /comparisons/{comparison_id}/series.csv"): ("text/csv",),
    _placed("GET /trends/{job_id}/table"): ("text/csv",),
    _placed("GET /runs/{run_id}/report"): ("text/html", "application/pdf"),
    _placed("GET /campaigns/{campaign_id}/report"): ("text/html", "application/pdf"),
    _placed("GET /comparisons/{comparison_id}/report"): ("text/html", "application/pdf"),
    _placed("GET /diagnoses/{diagnosis_id}/report"): ("text/html", "application/pdf"),
    _placed("GET /trends/{job_id}/report"): ("text/html", "application/pdf"),
    _placed("GET /designs/{job_id}/report"): ("text/html", "application/pdf"),
}
