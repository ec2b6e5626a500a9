"""Samples of runs: as columns, thinned for a picture, or as a file."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Query, Response
from fastapi.responses import StreamingResponse

from bench_service.api.dependencies import PathId, Services, ServicesOf
from bench_service.campaign.hardware import WARNED
from bench_service.errors import BadRequestError, ConflictError, GivenUpError
from bench_service.exchange.errors import UnknownFormatError
from bench_service.exchange.write import encode_run, export_formats
from bench_service.store.decimation import kept_rows
from bench_service.store.integrity import Expected, read_part
from bench_service.store.integrity import damaged as damaged_run
from bench_service.store.reading import StreamData
from bench_service.store.records import RunRecord
from bench_service.streams import OBSERVER, SAMPLES

router = APIRouter(prefix="/runs", tags=["samples"])

Time = Annotated[float | None, Query(allow_inf_nan=False)]
# A client that takes what is left of a damaged run says so; all others are refused.
Damaged = Annotated[Literal["refuse", "include"], Query()]
MaxPoints = Annotated[int | None, Query(ge=2, le=1_000_000)]
_SHAPED_BY = {SAMPLES: ("voltage_V", "current_A", "temperature_degC"), OBSERVER: ("soc", "innovation_V")}
_ROWS_PER_PART = 20_000


@router.get("/{run_id}/samples", response_class=StreamingResponse)
def get_samples(
    run_id: PathId,
    services: ServicesOf,
    from_s: Time = None,
    to_s: Time = None,
    max_points: MaxPoints = None,
    damaged: Damaged = "refuse",
) -> Response:
    """Give the samples with ``from_s <= time_s <= to_s``, at most ``max_points`` with their extremes kept.

    Where samples that were stored cannot be read: 409, or with ``damaged=include`` what is left as 206, and what is
    missing under ``gaps`` and ``damage``.
    """
    wanted = _Wanted(run_id, SAMPLES, from_s, to_s, damaged == "include")
    return _columns(services, wanted, max_points)


@router.get("/{run_id}/observer", response_class=StreamingResponse)
def get_observer(
    run_id: PathId,
    services: ServicesOf,
    from_s: Time = None,
    to_s: Time = None,
    max_points: MaxPoints = None,
    damaged: Damaged = "refuse",
) -> Response:
    """Give what the live observer said, as the samples are given."""
    wanted = _Wanted(run_id, OBSERVER, from_s, to_s, damaged == "include")
    return _columns(services, wanted, max_points)


@router.get("/{run_id}/export")
def export_run(
    run_id: PathId,
    services: ServicesOf,
    format_name: Annotated[str, Query(alias="format", max_length=20)] = "bdf",
    damaged: Damaged = "refuse",
) -> Response:
    """Give a run as a file; a damaged one only with ``damaged=include``, as 206 and with a name that says so."""
    run = services.store.runs.get(run_id)
    formats = export_formats()
    if format_name not in formats:
        raise UnknownFormatError(f"format {format_name!r} is not known; choose from {', '.join(sorted(formats))}")
    data, damage = _read(services, run, _Wanted(run_id, SAMPLES, None, None, damaged == "include"))
    if data.n == 0:
        raise ConflictError(f"run {run_id} has no samples to export", ("run", run_id))
    started = None if run.started_utc is None else datetime.fromisoformat(run.started_utc).timestamp()
    chosen = formats[format_name]
    # The name is made here: nothing a client sent reaches a header or a file.
    hardware = (run.commissioning or {}).get("state")
    marks = ("" if damage is None else "-damaged") + ("-unverified" if hardware in WARNED else "")
    headers = {"Content-Disposition": f'attachment; filename="run-{run.id}{marks}{chosen.suffix}"'}
    if hardware is not None:
        headers["X-Bench-Commissioning"] = hardware
    content = encode_run(data.columns, format_name, started)
    return Response(content, _status(damage), headers, chosen.media_type)


@dataclass(frozen=True, slots=True)
class _Wanted:
    """Rows of a stream that a client asks for, and whether it takes what is left of a damaged run."""

    run_id: str
    stream: str
    from_s: float | None
    to_s: float | None
    damaged: bool


def _columns(services: Services, wanted: _Wanted, max_points: int | None) -> Response:
    run = services.store.runs.get(wanted.run_id)
    if wanted.from_s is not None and wanted.to_s is not None and wanted.from_s > wanted.to_s:
        raise BadRequestError("from_s is after to_s", ("from_s",), value=wanted.from_s, unit="s", limit=wanted.to_s)
    data, damage = _read(services, run, wanted)
    rows = kept_rows(data.columns, data.n, max_points or data.n, _SHAPED_BY[wanted.stream])
    return StreamingResponse(_as_json(data, rows, damage), _status(damage), media_type="application/json")


def _read(services: Services, run: RunRecord, wanted: _Wanted) -> tuple[StreamData, str | None]:
    if run.removed_utc is not None:
        raise GivenUpError(f"the samples of run {run.id} were given up at {run.removed_utc}", ("run", run.id))
    data, damage = read_part(services.samples, Expected.of(run), wanted.stream, wanted.from_s, wanted.to_s)
    if damage is not None:
        services.storage.note_damage(run, damage)
        if not wanted.damaged:
            raise damaged_run(run.id, f"{damage}; ?damaged=include gives what is left")
    return data, damage


def _status(damage: str | None) -> int:
    return 200 if damage is None else 206


def _as_json(data: StreamData, rows: np.ndarray, damage: str | None) -> Iterator[str]:
    """Write ``{"columns": {name: [...]}, "n", "decimated"}`` part by part; a long run never is one string.

    What is left of a damaged run also has ``damage`` and ``gaps``.
    """
    yield '{"columns":{'
    columns: dict[str, Any] = {"seq": data.seq} | data.columns if data.n else {}
    for k, (name, values) in enumerate(columns.items()):
        yield f"{',' if k else ''}{json.dumps(name)}:["
        for start in range(0, len(rows), _ROWS_PER_PART):
            part = _numbers(values[rows[start : start + _ROWS_PER_PART]])
            yield f"{',' if start else ''}{json.dumps(part, allow_nan=False)[1:-1]}"
        yield "]"
    yield f'}},"n":{len(rows)},"decimated":{json.dumps(len(rows) < data.n)}'
    if damage is not None:
        gaps = [{"seq": gap.seq0, "n": gap.n, "reason": gap.reason} for gap in data.gaps]
        yield f',"damage":{json.dumps(damage)},"gaps":{json.dumps(gaps)}'
    yield "}"


def _numbers(values: np.ndarray) -> list[Any]:
    if values.dtype.kind != "f" or np.isfinite(values).all():
        return values.tolist()
    return [number if finite else None for number, finite in zip(values.tolist(), np.isfinite(values), strict=True)]
