"""Samples of runs: as columns, thinned for a picture, or as a file."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import datetime
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query, Response
from fastapi.responses import StreamingResponse

from bench_service.api.dependencies import PathId, Services, ServicesOf
from bench_service.errors import BadRequestError, ConflictError
from bench_service.exchange.errors import UnknownFormatError
from bench_service.exchange.write import encode_run, export_formats
from bench_service.store.decimation import kept_rows
from bench_service.store.reading import StreamData
from bench_service.streams import OBSERVER, SAMPLES

router = APIRouter(prefix="/runs", tags=["samples"])

Time = Annotated[float | None, Query(allow_inf_nan=False)]
MaxPoints = Annotated[int | None, Query(ge=2, le=1_000_000)]
_SHAPED_BY = {SAMPLES: ("voltage_V", "current_A", "temperature_degC"), OBSERVER: ("soc", "innovation_V")}
_ROWS_PER_PART = 20_000


@router.get("/{run_id}/samples", response_class=StreamingResponse)
def get_samples(
    run_id: PathId, services: ServicesOf, from_s: Time = None, to_s: Time = None, max_points: MaxPoints = None
) -> Response:
    """Give the samples with ``from_s <= time_s <= to_s``, at most ``max_points`` with their extremes kept."""
    return _columns(services, run_id, SAMPLES, from_s, to_s, max_points)


@router.get("/{run_id}/observer", response_class=StreamingResponse)
def get_observer(
    run_id: PathId, services: ServicesOf, from_s: Time = None, to_s: Time = None, max_points: MaxPoints = None
) -> Response:
    """Give what the live observer said, as the samples are given."""
    return _columns(services, run_id, OBSERVER, from_s, to_s, max_points)


@router.get("/{run_id}/export")
def export_run(
    run_id: PathId, services: ServicesOf, format_name: Annotated[str, Query(alias="format", max_length=20)] = "bdf"
) -> Response:
    """Give a run as a file."""
    run = services.store.runs.get(run_id)
    formats = export_formats()
    if format_name not in formats:
        raise UnknownFormatError(f"format {format_name!r} is not known; choose from {', '.join(sorted(formats))}")
    data = services.samples.read(run_id)
    if data.n == 0:
        raise ConflictError(f"run {run_id} has no samples to export", ("run", run_id))
    started = None if run.started_utc is None else datetime.fromisoformat(run.started_utc).timestamp()
    chosen = formats[format_name]
    # The name is made here: nothing a client sent reaches a header or a file.
    disposition = {"Content-Disposition": f'attachment; filename="run-{run.id}{chosen.suffix}"'}
    return Response(encode_run(data.columns, format_name, started), media_type=chosen.media_type, headers=disposition)


def _columns(
    services: Services, run_id: str, stream: str, from_s: float | None, to_s: float | None, max_points: int | None
) -> Response:
    services.store.runs.get(run_id)
    if from_s is not None and to_s is not None and from_s > to_s:
        raise BadRequestError("from_s is after to_s", ("from_s",), value=from_s, unit="s", limit=to_s)
    data = services.samples.read(run_id, stream, from_s, to_s)
    rows = kept_rows(data.columns, data.n, max_points or data.n, _SHAPED_BY[stream])
    return StreamingResponse(_as_json(data, rows), media_type="application/json")


def _as_json(data: StreamData, rows: np.ndarray) -> Iterator[str]:
    """Write ``{"columns": {name: [...]}, "n", "decimated"}`` part by part; a long run never is one string."""
    yield '{"columns":{'
    columns: dict[str, Any] = {"seq": data.seq} | data.columns if data.n else {}
    for k, (name, values) in enumerate(columns.items()):
        yield f"{',' if k else ''}{json.dumps(name)}:["
        for start in range(0, len(rows), _ROWS_PER_PART):
            part = _numbers(values[rows[start : start + _ROWS_PER_PART]])
            yield f"{',' if start else ''}{json.dumps(part, allow_nan=False)[1:-1]}"
        yield "]"
    yield f'}},"n":{len(rows)},"decimated":{json.dumps(len(rows) < data.n)}}}'


def _numbers(values: np.ndarray) -> list[Any]:
    if values.dtype.kind != "f" or np.isfinite(values).all():
        return values.tolist()
    return [number if finite else None for number, finite in zip(values.tolist(), np.isfinite(values), strict=True)]
