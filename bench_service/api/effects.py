"""Versions of a model: effects known and added, parameters refitted, and what every version was worth."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import Field

from bench_service.api.answers import asked, job, keyed, listed, shown
from bench_service.api.dependencies import PathId, ServicesOf
from bench_service.api.strict import Body, Id, StrictRoute
from bench_service.campaign.diagnosing import catalogue
from bench_service.campaign.learning import LearningOrder
from bench_service.campaign.versions import chain

router = APIRouter(tags=["effects"], route_class=StrictRoute)

RunIds = Annotated[list[Id], Field(min_length=1, max_length=100)]


class EffectBody(Body):
    """An effect to add; without run ids those of the parent model train and judge."""

    effect: Id
    train_run_ids: RunIds | None = None
    validate_run_ids: RunIds | None = None


@router.get(
    "/effects",
    openapi_extra=listed("effects")
    | shown(
        {
            "effects": [
                {
                    "name": "capacity",
                    "title": "Capacity",
                    "parameters": [{"name": "capacity_Ah", "unit": "Ah", "meaning": "capacity of the cell"}],
                }
            ]
        }
    ),
)
def list_effects() -> dict[str, Any]:
    """List every effect that a diagnosis knows, with how a person recognises it."""
    return {"effects": catalogue()}


@router.post(
    "/models/{model_id}/effects",
    status_code=202,
    openapi_extra=job()
    | asked({"effect": "hysteresis", "train_run_ids": ["c49cf9aa"], "validate_run_ids": ["96fcc6a2"]}),
)
async def add_effect(model_id: PathId, body: EffectBody, services: ServicesOf) -> dict[str, Any]:
    """Add an effect to a model and refit it in a worker process; answers with the job, whose result names the child."""
    job = await services.diagnosing.start_addition(model_id, body.effect, body.train_run_ids, body.validate_run_ids)
    return asdict(job)


class RefitBody(Body):
    """New runs to fit a model's parameters to; without ``validate_run_ids`` those of the parent model judge."""

    train_run_ids: RunIds
    validate_run_ids: RunIds | None = None


@router.post("/models/{model_id}/refit", status_code=202, openapi_extra=job() | asked({"train_run_ids": ["96fcc6a2"]}))
async def refit(model_id: PathId, body: RefitBody, services: ServicesOf) -> dict[str, Any]:
    """Fit a model's parameters again to new runs; answers with the job, whose result names the child."""
    return asdict(await services.diagnosing.start_refit(model_id, body.train_run_ids, body.validate_run_ids))


class LearnBody(Body):
    """Runs of one cell in time's order; without ``validate_run_ids`` each next run judges the version before it."""

    run_ids: RunIds
    validate_run_ids: Annotated[list[Id], Field(max_length=100)] = []


@router.post(
    "/models/{model_id}/learn", status_code=202, openapi_extra=job() | asked({"run_ids": ["c49cf9aa", "96fcc6a2"]})
)
async def learn(model_id: PathId, body: LearnBody, services: ServicesOf) -> dict[str, Any]:
    """Let a model learn from stored runs, a version each; answers with the job, whose result names the versions."""
    order = LearningOrder(model_id=model_id, run_ids=body.run_ids, validate_run_ids=body.validate_run_ids)
    return asdict(await services.learning.start_learning(order))


@router.get(
    "/models/{model_id}/chain",
    openapi_extra=keyed("model_id", "chain", "noise_floor_mV", "models")
    | shown(
        {
            "model_id": "1e2ec3ed",
            "chain": ["1e2ec3ed"],
            "noise_floor_mV": 1.03,
            "models": [{"id": "1e2ec3ed", "name": "left cell", "parent_id": None, "effect": None}],
        }
    ),
)
def get_chain(model_id: PathId, services: ServicesOf) -> dict[str, Any]:
    """Give the versions that led to a model and those tried beside them, each with its held-out error."""
    return chain(services.store, model_id)
