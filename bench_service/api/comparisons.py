"""Comparisons of a model with runs."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated, Literal, get_args

from fastapi import APIRouter, Depends, Query, Response
from pydantic import Field

from bench_service.api.answers import asked, files, keyed, paged, record, shown
from bench_service.api.dependencies import Answer, CellFilter, PageOf, PathId, ServicesOf
from bench_service.api.strict import JSON_TYPE, Body, Id, Soc, StrictRoute
from bench_service.campaign.comparison_curves import CurvePart
from bench_service.errors import BadRequestError
from bench_service.store.records import ComparisonRecord

router = APIRouter(prefix="/comparisons", tags=["comparisons"], route_class=StrictRoute)

Time = Annotated[float | None, Query(allow_inf_nan=False)]
MostPoints = Annotated[int | None, Query(ge=2, le=20_000)]
_POINTS = 2000
# Those of `models.baselines.beside`, which takes a second to import.
Baseline = Literal["1rc", "2rc", "esc"]


@dataclass(frozen=True, slots=True)
class Part:
    """Which part of the curves, and how finely; see `get_series`."""

    from_s: Time = None
    to_s: Time = None
    points: MostPoints = None
    max_points: MostPoints = None


PartOf = Annotated[Part, Depends()]


class ComparisonBody(Body):
    """What to compare; ``initial_soc`` replaces that of ``run_ids``.

    ``baselines``: fitted to ``train_run_ids``, without these to the runs that the model was made from, and judged on
    ``run_ids`` beside the model: 1rc, 2rc (equivalent circuits), esc (Plett).
    """

    model_id: Id
    run_ids: Annotated[list[Id], Field(min_length=1, max_length=100)]
    initial_soc: Soc | None = None
    baselines: Annotated[list[Baseline], Field(max_length=len(get_args(Baseline)))] = []
    train_run_ids: Annotated[list[Id], Field(min_length=1, max_length=100)] | None = None


@router.post(
    "",
    status_code=201,
    openapi_extra=record("Comparison") | asked({"model_id": "1e2ec3ed", "run_ids": ["c49cf9aa"], "initial_soc": 0.5}),
)
async def compare(body: ComparisonBody, services: ServicesOf) -> Answer:
    """Compare a model with runs, in a worker process; answers when it is done.

    With ``baselines``, ``result`` also has ``baselines``: ``name``, ``overall`` and ``runs`` of each.
    """
    if body.train_run_ids is not None and not body.baselines:
        raise BadRequestError(
            "train_run_ids are what baselines are fitted to, and there is none",
            ("train_run_ids",),
            remedy="name baselines too, or leave them out",
        )
    beside = {"baselines": body.baselines, "train_run_ids": body.train_run_ids}
    return _as_json(await services.modelling.compare(body.model_id, body.run_ids, body.initial_soc, **beside))


@router.get("", openapi_extra=paged("comparisons", "Comparison"))
def list_comparisons(
    services: ServicesOf,
    page: PageOf,
    model_id: Annotated[str | None, Query(max_length=64)] = None,
    cell_id: CellFilter = None,
) -> Answer:
    """List comparisons, newest first; of one model or one cell where that is given."""
    found = services.store.comparisons.page(model_id, cell_id=cell_id, **page.asked)
    return page.answer(services, ("comparisons", "comparison"), found, _as_json)


@router.get("/{comparison_id}", openapi_extra=record("Comparison"))
def get_comparison(comparison_id: PathId, services: ServicesOf) -> Answer:
    """Give one comparison."""
    return _as_json(services.store.comparisons.get(comparison_id))


@router.get(
    "/{comparison_id}/series",
    openapi_extra=keyed("runs")
    | shown(
        {
            "runs": [
                {
                    "run_id": "c49cf9aa",
                    "time_s": [0.0, 2.0],
                    "measured_V": [3.9567, 4.0093],
                    "model_V": [3.9549, 4.0054],
                    "residual_mV": [1.8, 3.9],
                }
            ]
        }
    ),
)
async def get_series(comparison_id: PathId, part: PartOf, services: ServicesOf) -> Response:
    """Give measured and free-run voltage of each run, ``{"runs": [{"run_id", "time_s", "measured_V", ...}]}``.

    Those with ``from_s <= time_s <= to_s``, at most ``points`` of each run with all extremes kept (``max_points`` is
    its older name). Simulated in a worker when first asked for, then kept.
    """
    if part.from_s is not None and part.to_s is not None and part.from_s > part.to_s:
        raise BadRequestError("from_s is after to_s", ("from_s",), value=part.from_s, unit="s", limit=part.to_s)
    wanted = CurvePart(part.from_s, part.to_s, part.points or part.max_points or _POINTS)
    return Response(await services.modelling.comparison_series(comparison_id, wanted), media_type=JSON_TYPE)


@router.get("/{comparison_id}/series.csv", openapi_extra=files("text/csv"))
async def get_table(comparison_id: PathId, services: ServicesOf) -> Response:
    """Give every sample on the model's grid, the columns of `compare --out`, as a file.

    Both voltages, half the width of the 95 % band, and 1 where the sample lies in the trained domain.
    """
    table = await services.modelling.comparison_table(comparison_id)
    # The name is made here: nothing a client sent reaches a header or a file.
    disposition = {"Content-Disposition": 'attachment; filename="comparison.csv"'}
    return Response(table, media_type="text/csv", headers=disposition)


def _as_json(record: ComparisonRecord) -> Answer:
    return asdict(record) | {"run_ids": list(record.run_ids)}
