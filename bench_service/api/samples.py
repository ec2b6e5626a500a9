"""Samples of runs: as columns, thinned for a picture, or as a file."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Depends, Query, Request, Response
from fastapi.responses import StreamingResponse

from bench_service.api.answers import files, keyed, shown
from bench_service.api.compression import compressed
from bench_service.api.dependencies import Answer, PathId, Services, ServicesOf
from bench_service.api.formats import known_formats
from bench_service.campaign.crating import CRATE, crate_of
from bench_service.campaign.exporting import Export
from bench_service.campaign.hardware import WARNED
from bench_service.errors import BadRequestError, ConflictError, GivenUpError
from bench_service.exchange.bdf_metadata import SUFFIX as METADATA_SUFFIX
from bench_service.exchange.errors import UnknownFormatError
from bench_service.exchange.write import encode_run
from bench_service.store.decimation import kept_rows
from bench_service.store.integrity import Expected, read_part
from bench_service.store.integrity import damaged as damaged_run
from bench_service.store.reading import StreamData
from bench_service.store.records import RunRecord
from bench_service.streams import OBSERVER, SAMPLES, Flag

router = APIRouter(prefix="/runs", tags=["samples"])

Time = Annotated[float | None, Query(allow_inf_nan=False)]
# A client that takes what is left of a damaged run says so; all others are refused.
Damaged = Annotated[Literal["refuse", "include"], Query()]
MostPoints = Annotated[int | None, Query(ge=2, le=1_000_000)]
AfterSeq = Annotated[int | None, Query(ge=-1, le=2**62)]
Names = Annotated[str | None, Query(max_length=400)]
_SHAPED_BY = {SAMPLES: ("voltage_V", "current_A", "temperature_degC"), OBSERVER: ("soc", "innovation_V")}
_STEPPED_BY = ("setpoint_A", "marks", "step_count")
# Flags that a picture marks: where one of them comes or goes is a step too.
_MARKS = Flag.GAP_BEFORE | Flag.SUSPECT | Flag.PAUSED
_ROWS_PER_PART = 20_000
_FEWEST_ROWS = 2


@dataclass(frozen=True, slots=True)
class Part:
    """Which rows and columns of a stream a client asks for; see `get_samples`."""

    from_s: Time = None
    to_s: Time = None
    after_seq: AfterSeq = None
    points: MostPoints = None
    max_points: MostPoints = None
    columns: Names = None
    damaged: Damaged = "refuse"

    @property
    def most(self) -> int | None:
        """Most rows of a picture; None: all rows are asked for."""
        return self.points or self.max_points

    @property
    def names(self) -> tuple[str, ...] | None:
        """Names of the columns; None: those that are stored."""
        return None if self.columns is None else tuple(name.strip() for name in self.columns.split(","))


@dataclass(frozen=True, slots=True)
class Steps:
    """Which part of a run, and how finely; see `get_incremental`."""

    from_s: Time = None
    to_s: Time = None
    step_mV: Annotated[float, Query(ge=0.1, le=1000.0)] = 5.0
    step_share: Annotated[float, Query(ge=1e-4, le=0.5)] = 0.005
    damaged: Damaged = "refuse"


PartOf = Annotated[Part, Depends()]
Span = Annotated[Steps, Depends()]


@router.get(
    "/{run_id}/samples",
    response_class=StreamingResponse,
    openapi_extra=keyed("columns", "n", "decimated")
    | shown(
        {
            "columns": {
                "seq": [0, 1],
                "time_s": [0.0, 1.0],
                "current_A": [0.0, 1.6655],
                "voltage_V": [3.9567, 4.0051],
                "temperature_degC": [25.0, 25.02],
            },
            "n": 2,
            "decimated": False,
        }
    ),
)
def get_samples(run_id: PathId, part: PartOf, request: Request, services: ServicesOf) -> Response:
    """Give the samples with ``from_s <= time_s <= to_s``, those after row ``after_seq`` where that is given.

    With ``points`` (``max_points`` is its older name) at most so many rows, extremes and steps kept. ``columns`` names
    those that are wanted, with commas between; beside the stored ones there are ``charge_Ah`` and ``energy_Wh``,
    counted from the start of the run. Where samples that were stored cannot be read: 409, or with ``damaged=include``
    what is left as 206, and what is missing under ``gaps`` and ``damage``.
    """
    return _columns(services, request, run_id, SAMPLES, part)


@router.get(
    "/{run_id}/observer",
    response_class=StreamingResponse,
    openapi_extra=keyed("columns", "n", "decimated")
    | shown(
        {
            "columns": {"seq": [0, 1], "time_s": [0.0, 1.0], "soc": [0.7731, 0.7742], "soc_std": [0.0034, 0.0031]},
            "n": 2,
            "decimated": False,
        }
    ),
)
def get_observer(run_id: PathId, part: PartOf, request: Request, services: ServicesOf) -> Response:
    """Give what the live observer said, as the samples are given."""
    return _columns(services, request, run_id, OBSERVER, part)


@router.get(
    "/{run_id}/incremental",
    openapi_extra=keyed()
    | shown(
        {"charge": {"voltage_V": [3.4825], "dQ_dV_Ah_per_V": [0.13], "charge_Ah": [-1.5], "dV_dQ_V_per_Ah": [2.0]}}
    ),
)
def get_incremental(run_id: PathId, part: Span, request: Request, services: ServicesOf) -> Response:
    """Give dQ/dV over voltage and dV/dQ over charge of a run, or of a part of it, charge and discharge apart.

    Counted from every sample into steps of ``step_mV`` and of ``step_share`` of the capacity.
    """
    run = services.store.runs.get(run_id)
    data, damage = _read(services, run, SAMPLES, Part(part.from_s, part.to_s, points=2, damaged=part.damaged))
    both = {}
    if data.n >= _FEWEST_ROWS:
        voltage_V, charge_Ah = data.columns["voltage_V"], data.columns["charge_Ah"]
        # Lazy: the read-outs stand on the network, which takes 900 ms.
        from models.readouts.incremental import incremental

        both = incremental(voltage_V, charge_Ah, 1e-3 * part.step_mV, part.step_share * run.capacity_Ah)
    answer = {
        name: {key: _numbers(getattr(found, key)) for key in found.__dataclass_fields__} for name, found in both.items()
    }
    return compressed(request, iter([json.dumps(answer, allow_nan=False)]), _status(damage))


@router.get("/{run_id}/export", openapi_extra=files("text/csv", "application/zip", "application/octet-stream"))
def export_run(
    run_id: PathId,
    services: ServicesOf,
    format_name: Annotated[str, Query(alias="format", max_length=20)] = "bdf",
    damaged: Damaged = "refuse",
) -> Response:
    """Give a run as a file; a damaged one only with ``damaged=include``, as 206 and with a name that says so.

    With ``ro-crate`` it is a bundle of the run and all that was made from it, which no damaged run becomes.
    """
    run = services.store.runs.get(run_id)
    kinds = {each["name"]: each for each in known_formats()}
    if format_name not in kinds:
        raise UnknownFormatError(f"format {format_name!r} is not known; choose from {', '.join(sorted(kinds))}")
    whole = format_name == CRATE
    data, damage = _read(services, run, SAMPLES, Part(damaged="refuse" if whole else damaged))
    if data.n == 0:
        raise ConflictError(f"run {run_id} has no samples to export", ("run", run_id))
    export = _export(services, run)
    chosen = kinds[format_name]
    content = crate_of(export, data.columns) if whole else encode_run(data.columns, format_name, export.started_unix_s)
    hardware = (run.commissioning or {}).get("state")
    marks = ("" if damage is None else "-damaged") + ("-unverified" if hardware in WARNED else "")
    # The name is made here: nothing a client sent reaches a header or a file.
    headers = {"Content-Disposition": f'attachment; filename="{export.name}{marks}{chosen["suffix"]}"'}
    if hardware is not None:
        headers["X-Bench-Commissioning"] = hardware
    return Response(content, _status(damage), headers, chosen["media_type"])


@router.get(
    "/{run_id}/metadata",
    openapi_extra=keyed("bdf", "raw")
    | shown(
        {
            "bdf": {"source": "bench-service 0.1.0"},
            "raw": {"institution": "laboratory", "current_sign": "positive charges"},
        }
    ),
)
def get_metadata(run_id: PathId, services: ServicesOf, response: Response) -> Answer:
    """Give the metadata file that belongs beside a run's file of the Battery Data Format."""
    export = _export(services, services.store.runs.get(run_id))
    response.headers["Content-Disposition"] = f'attachment; filename="{export.name}{METADATA_SUFFIX}"'
    return export.metadata()


def _export(services: Services, run: RunRecord) -> Export:
    return Export(services.store, run, services.config.institution, services.version)


def _columns(services: Services, request: Request, run_id: str, stream: str, part: Part) -> Response:
    run = services.store.runs.get(run_id)
    if part.from_s is not None and part.to_s is not None and part.from_s > part.to_s:
        raise BadRequestError("from_s is after to_s", ("from_s",), value=part.from_s, unit="s", limit=part.to_s)
    data, damage = _read(services, run, stream, part)
    marks = {"marks": data.columns["flags"] & _MARKS} if "flags" in data.columns else {}
    rows = kept_rows(data.columns | marks, data.n, part.most or data.n, _SHAPED_BY[stream], _STEPPED_BY)
    return compressed(request, _as_json(data, rows, damage, _chosen(data, part.names)), _status(damage))


def _read(services: Services, run: RunRecord, stream: str, part: Part) -> tuple[StreamData, str | None]:
    """Read what is asked for; a picture, and what is counted, comes from memory where the run was looked at before."""
    if run.removed_utc is not None:
        raise GivenUpError(f"the samples of run {run.id} were given up at {run.removed_utc}", ("run", run.id))
    if part.most is None and part.after_seq is None and part.names is None:
        data, damage = read_part(services.samples, Expected.of(run), stream, part.from_s, part.to_s)
    else:
        view = services.views.view(run, stream)
        data, damage = view.part(part.from_s, part.to_s, part.after_seq), view.damage
    if damage is not None:
        services.storage.note_damage(run, damage)
        if part.damaged != "include":
            raise damaged_run(run.id, f"{damage}; ?damaged=include gives what is left")
    return data, damage


def _chosen(data: StreamData, names: tuple[str, ...] | None) -> list[str]:
    """Columns of the answer, in their order; those that are counted only where they are asked for."""
    if names is None:
        return ["seq", *(column.name for column in data.layout)]
    known = {"seq"} | set(data.columns)
    if data.layout and (strange := [name for name in names if name not in known]):
        raise BadRequestError(f"no column {strange[0]!r}; there are {', '.join(sorted(known))}", ("columns",))
    return list(names)


def _status(damage: str | None) -> int:
    return 200 if damage is None else 206


def _as_json(data: StreamData, rows: np.ndarray, damage: str | None, names: list[str]) -> Iterator[str]:
    """Write ``{"columns": {name: [...]}, "n", "decimated"}`` part by part; a long run never is one string.

    What is left of a damaged run also has ``damage`` and ``gaps``.
    """
    yield '{"columns":{'
    for k, name in enumerate(names if data.n else ()):
        values = data.seq if name == "seq" else data.columns[name]
        yield f"{',' if k else ''}{json.dumps(name)}:["
        for start in range(0, len(rows), _ROWS_PER_PART):
            part = _numbers(values[rows[start : start + _ROWS_PER_PART]])
            yield f"{',' if start else ''}{json.dumps(part, allow_nan=False, separators=(',', ':'))[1:-1]}"
        yield "]"
    yield f'}},"n":{len(rows)},"decimated":{json.dumps(len(rows) < data.n)}'
    if damage is not None:
        gaps = [{"seq": gap.seq0, "n": gap.n, "reason": gap.reason} for gap in data.gaps]
        yield f',"damage":{json.dumps(damage)},"gaps":{json.dumps(gaps)}'
    yield "}"


def _numbers(values: np.ndarray) -> list[Any]:
    # Single precision has seven digits; as double precision it would be written with seventeen.
    plain = [float(str(each)) for each in values] if values.dtype == np.float32 else values.tolist()
    if values.dtype.kind != "f" or np.isfinite(values).all():
        return plain
    return [number if finite else None for number, finite in zip(plain, np.isfinite(values), strict=True)]
