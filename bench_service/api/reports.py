"""Reports for people: of a run, campaign, comparison, diagnosis, life or design, as a page or as PDF."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Response

from bench_service.api.answers import files
from bench_service.api.dependencies import PathId, Services, ServicesOf
from bench_service.reports.document import security_headers

router = APIRouter(tags=["reports"])

_FILE = files("text/html", "application/pdf")
Kind = Annotated[Literal["html", "pdf"], Query(alias="format")]


@router.get("/runs/{run_id}/report", response_class=Response, openapi_extra=_FILE)
async def report_run(run_id: PathId, services: ServicesOf, kind: Kind = "html") -> Response:
    """Give the report of a run: what was decided, measured and noted; PDF needs Chromium beside the service."""
    return await _answer(services, "run", run_id, await services.reporting.run(run_id), kind)


@router.get("/campaigns/{campaign_id}/report", response_class=Response, openapi_extra=_FILE)
async def report_campaign(campaign_id: PathId, services: ServicesOf, kind: Kind = "html") -> Response:
    """Give the report of a campaign as far as it came."""
    return await _answer(services, "campaign", campaign_id, await services.reporting.campaign(campaign_id), kind)


@router.get("/comparisons/{comparison_id}/report", response_class=Response, openapi_extra=_FILE)
async def report_comparison(comparison_id: PathId, services: ServicesOf, kind: Kind = "html") -> Response:
    """Give the report of a comparison; its curves are simulated in a worker."""
    page = await services.reporting.comparison(comparison_id)
    return await _answer(services, "comparison", comparison_id, page, kind)


@router.get("/diagnoses/{diagnosis_id}/report", response_class=Response, openapi_extra=_FILE)
async def report_diagnosis(diagnosis_id: PathId, services: ServicesOf, kind: Kind = "html") -> Response:
    """Give the report of a diagnosis with its evidence; its curves are simulated in a worker."""
    page = await services.reporting.diagnosis(diagnosis_id)
    return await _answer(services, "diagnosis", diagnosis_id, page, kind)


@router.get("/trends/{job_id}/report", response_class=Response, openapi_extra=_FILE)
async def report_trend(job_id: PathId, services: ServicesOf, kind: Kind = "html") -> Response:
    """Give the report of a cell's life, as long as the job that has followed it is known."""
    return await _answer(services, "life", job_id, await services.reporting.trend(job_id), kind)


@router.get("/designs/{job_id}/report", response_class=Response, openapi_extra=_FILE)
async def report_design(job_id: PathId, services: ServicesOf, kind: Kind = "html") -> Response:
    """Give the report of a design, as long as the job that has made it is known."""
    return await _answer(services, "design", job_id, await services.reporting.design(job_id), kind)


async def _answer(services: Services, what: str, name: str, page: bytes, kind: str) -> Response:
    if kind == "pdf":
        # The name is made here: of an id that was looked up, no more than letters and digits.
        short = "".join(letter for letter in name[:8] if letter.isalnum())
        headers = {"Content-Disposition": f'inline; filename="{what}-{short}.pdf"'}
        return Response(await services.reporting.printed(page), headers=headers, media_type="application/pdf")
    return Response(page, headers=security_headers(), media_type="text/html; charset=utf-8")
