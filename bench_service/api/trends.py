"""Trends: what has become of a cell over its runs, against a model of the cell as it was."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Response
from pydantic import Field

from bench_service.api.answers import asked, files, job
from bench_service.api.dependencies import Answer, PathId, ServicesOf
from bench_service.api.strict import CSV_TYPE, Body, Id, Soc, StrictRoute
from bench_service.campaign.trending import MOST_RUNS, TrendOrder

router = APIRouter(prefix="/trends", tags=["trends"], route_class=StrictRoute)


class TrendBody(Body):
    """Runs in time's order; ``initial_soc`` and ``at`` have one value for each of them.

    ``initial_soc`` is a fraction of what the cell holds then: 1 is full, however aged. ``at`` are places along the
    life in ``unit``, such as cycles; without them the runs are counted. ``end`` is the share of the capacity that is
    the end of life. Without ``train_run_ids`` the model's own runs are the cell as it was. With ``cell_id`` in place of
    ``run_ids`` all that the cell has completed is followed.
    """

    model_id: Id
    run_ids: Annotated[list[Id], Field(min_length=1, max_length=MOST_RUNS)] | None = None
    cell_id: Id | None = None
    train_run_ids: Annotated[list[Id], Field(max_length=100)] | None = None
    initial_soc: Annotated[list[Soc], Field(max_length=MOST_RUNS)] | None = None
    initial_soc_std: Soc | None = None
    at: Annotated[list[Annotated[float, Field(allow_inf_nan=False)]], Field(max_length=MOST_RUNS)] | None = None
    unit: Annotated[str, Field(min_length=1, max_length=20)] = "run"
    end: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.8


@router.post(
    "",
    status_code=202,
    openapi_extra=job()
    | asked(
        {
            "model_id": "1e2ec3ed",
            "run_ids": ["c49cf9aa", "96fcc6a2"],
            "initial_soc": [1.0, 1.0],
            "at": [0.0, 100.0],
            "unit": "cycle",
            "end": 0.8,
        }
    ),
)
async def start_trend(body: TrendBody, services: ServicesOf) -> Answer:
    """Follow a cell in a worker process; answers with the job, whose result is the trend."""
    return asdict(await services.trending.start_trend(TrendOrder(**body.model_dump())))


@router.get("/{job_id}/table", response_class=Response, openapi_extra=files("text/csv"))
async def get_table(job_id: PathId, services: ServicesOf) -> Response:
    """Give the answer of a job as CSV, a row a run; as long as the job is known."""
    headers = {"Content-Disposition": f'attachment; filename="life-{job_id}.csv"'}
    return Response(services.trending.table(job_id), media_type=CSV_TYPE, headers=headers)
