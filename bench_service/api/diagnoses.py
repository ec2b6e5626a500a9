"""Diagnoses: which effect a model lacks, or what is new in its cell; and where the model of a comparison is off."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import Field

from bench_service.api.answers import asked, job, keyed, paged, record, shown
from bench_service.api.dependencies import Answer, CellFilter, PageOf, PathId, ServicesOf
from bench_service.api.strict import Body, Id, Soc, StrictRoute
from bench_service.campaign.diagnosing import DiagnosisOrder
from bench_service.campaign.request import known_standing
from bench_service.campaign.standing import last_standing
from bench_service.store.diagnoses import DiagnosisRecord

router = APIRouter(tags=["diagnoses"], route_class=StrictRoute)


class DiagnosisBody(Body):
    """What to diagnose; without ``train_run_ids`` the model's own, ``initial_soc`` replaces that of ``run_ids``.

    ``initial_soc_std``: how sure it is; without it as a careful statement is.
    """

    model_id: Id
    run_ids: Annotated[list[Id], Field(min_length=1, max_length=100)]
    train_run_ids: Annotated[list[Id], Field(max_length=100)] | None = None
    mode: Literal["structure", "change"] = "structure"
    initial_soc: Soc | None = None
    initial_soc_std: Soc | None = None


@router.post(
    "/diagnoses",
    status_code=202,
    openapi_extra=job()
    | asked(
        {"model_id": "1e2ec3ed", "run_ids": ["96fcc6a2"], "mode": "change", "initial_soc": 0.5, "initial_soc_std": 0.01}
    ),
)
async def start_diagnosis(body: DiagnosisBody, services: ServicesOf) -> Answer:
    """Diagnose runs in a worker process; answers with the job, whose result names the diagnosis."""
    return asdict(await services.diagnosing.start_diagnosis(DiagnosisOrder(**body.model_dump())))


@router.get("/diagnoses", openapi_extra=paged("diagnoses", "Diagnosis"))
def list_diagnoses(
    services: ServicesOf,
    page: PageOf,
    model_id: Annotated[str | None, Query(max_length=64)] = None,
    cell_id: CellFilter = None,
) -> Answer:
    """List diagnoses, newest first; of one model or one cell where that is given."""
    found = services.store.diagnoses.page(model_id, cell_id=cell_id, **page.asked)
    return page.answer(services, ("diagnoses", "diagnosis"), found, _as_json)


@router.get("/diagnoses/{diagnosis_id}", openapi_extra=record("Diagnosis"))
def get_diagnosis(diagnosis_id: PathId, services: ServicesOf) -> Answer:
    """Give one diagnosis."""
    return _as_json(services.store.diagnoses.get(diagnosis_id))


class ExperimentBody(Body):
    """Where the next experiment is to be played; ``initial_soc`` where nobody else knows how the cell stands."""

    bench: Id
    initial_soc: Soc | None = None


@router.post(
    "/diagnoses/{diagnosis_id}/experiment",
    status_code=202,
    openapi_extra=job() | asked({"bench": "sim", "initial_soc": 0.5}),
)
async def design_experiment(diagnosis_id: PathId, body: ExperimentBody, services: ServicesOf) -> Answer:
    """Design the profile that tells the rivals of a diagnosis apart; answers with the job, which stores a profile."""
    bench = services.benches.get(body.bench)
    last = await asyncio.to_thread(last_standing, bench, services.store, services.samples)
    standing = known_standing(bench, body.initial_soc, last)
    return asdict(await services.diagnosing.start_experiment(diagnosis_id, bench.sampled_limits, standing.soc))


@router.get(
    "/comparisons/{comparison_id}/where",
    openapi_extra=keyed()
    | shown(
        {
            "maps": [],
            "regions": [{"text": "51 % of the squared error in 24 % of the time: SoC above 0.7", "rmse_mV": 15.2}],
        }
    ),
)
async def get_where(comparison_id: PathId, services: ServicesOf) -> Answer:
    """Give the regions in which the error is concentrated, and maps of it over two variables; made in a worker."""
    return await services.diagnosing.where(comparison_id)


def _as_json(record: DiagnosisRecord) -> Answer:
    return asdict(record) | {"run_ids": list(record.run_ids), "train_run_ids": list(record.train_run_ids)}
