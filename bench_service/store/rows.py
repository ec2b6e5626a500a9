"""Rows of the metadata tables to records, and back where the two differ."""

import hashlib
import json
import uuid
from dataclasses import asdict
from typing import Any, cast, get_args

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Row, select

from bench_service.errors import StoreError
from bench_service.store import blocks, schema
from bench_service.store.records import (
    CampaignRecord,
    ComparisonRecord,
    EventRecord,
    Json,
    ModelRecord,
    ProfileRecord,
    RunRecord,
    RunReference,
    RunState,
)
from bench_service.streams import Column

_POINTS = (Column("time_s", "f8"), Column("current_A", "f8"))

# Without the large columns, which are read one at a time.
PROFILE = select(*(c for c in schema.profile.c if c.name not in ("codec", "crc", "data")))
MODEL = select(*(c for c in schema.model.c if c.name != "document"))


def new_profile(
    profile_id: str, name: str, time_s: NDArray[np.float64], current_A: NDArray[np.float64], created_utc: str
) -> tuple[ProfileRecord, Json]:
    """Return a profile and its row; the current holds from its time to the next (forward hold)."""
    times, currents = np.asarray(time_s, "<f8"), np.asarray(current_A, "<f8")
    block = blocks.encode(0, _POINTS, {"time_s": times, "current_A": currents})
    charge_Ah = np.concatenate(([0.0], np.cumsum(currents[:-1] * np.diff(times)) / 3600.0))
    record = ProfileRecord(
        id=profile_id,
        name=name,
        sha256=_points_hash(times, currents),
        n_points=block.n,
        duration_s=float(times[-1] - times[0]),
        current_A=(float(currents.min()), float(currents.max())),
        charge_Ah=(float(charge_Ah[-1]), float(charge_Ah.min()), float(charge_Ah.max())),
        created_utc=created_utc,
    )
    row = asdict(record)
    row["current_min_A"], row["current_max_A"] = row.pop("current_A")
    row["charge_net_Ah"], row["charge_min_Ah"], row["charge_max_Ah"] = row.pop("charge_Ah")
    return record, row | {"codec": block.codec, "crc": block.crc, "data": block.data}


def profile_points(row: Row[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times in s and currents in A of a profile.

    Raises
    ------
    StoreError
        The stored points are damaged.
    """
    try:
        _layout, points = blocks.decode(blocks.Block(0, row.n_points, row.codec, row.crc, row.data))
    except blocks.BlockError as error:
        raise StoreError(f"profile {row.id} is damaged in the store: {error}") from error
    return points["time_s"], points["current_A"]


def checked_points(row: Row[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and currents of a profile that are proved to be those that were stored; raises `StoreError`."""
    time_s, current_A = profile_points(row)
    if _points_hash(time_s, current_A) != row.sha256:
        raise StoreError(f"profile {row.id} is damaged in the store: its points have another hash")
    return time_s, current_A


def _points_hash(time_s: NDArray[np.float64], current_A: NDArray[np.float64]) -> str:
    return hashlib.sha256(np.asarray(time_s, "<f8").tobytes() + np.asarray(current_A, "<f8").tobytes()).hexdigest()


def profile(row: Row[Any]) -> ProfileRecord:
    """Return a profile."""
    return ProfileRecord(
        id=row.id,
        name=row.name,
        sha256=row.sha256,
        n_points=row.n_points,
        duration_s=row.duration_s,
        current_A=(row.current_min_A, row.current_max_A),
        charge_Ah=(row.charge_net_Ah, row.charge_min_Ah, row.charge_max_Ah),
        created_utc=row.created_utc,
    )


def run(row: Row[Any]) -> RunRecord:
    """Return a run."""
    return RunRecord(**fields(row), number=row.number)


def run_state(text: str) -> RunState:
    """Return a run's state as the recorder has it; what it does not know is an interruption."""
    return cast(RunState, text) if text in get_args(RunState) else "interrupted"


def model(row: Row[Any]) -> ModelRecord:
    """Return a model."""
    values = fields(row)
    values["train"] = references(row.train)
    values["validate"] = references(row.validate)
    return ModelRecord(**values)


def comparison(row: Row[Any]) -> ComparisonRecord:
    """Return a comparison."""
    values = fields(row)
    values["runs"] = references(row.runs)
    return ComparisonRecord(**values)


def campaign(row: Row[Any]) -> CampaignRecord:
    """Return a campaign."""
    values = fields(row)
    values["stages"] = tuple(row.stages)
    return CampaignRecord(**values)


def event(row: Row[Any]) -> EventRecord:
    """Return an event."""
    return EventRecord(**fields(row))


def document_hash(document: Json) -> str:
    """Return the SHA-256 of a document in canonical JSON."""
    return hashlib.sha256(json.dumps(document, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def new_id() -> str:
    """Return an id that nothing else has."""
    return uuid.uuid4().hex


def references(data: list[Json]) -> tuple[RunReference, ...]:
    """Return runs with their hashes."""
    return tuple(RunReference(**item) for item in data)


def fields(row: Row[Any]) -> Json:
    """Return a row's values by column, without the number that orders rows."""
    values = row._mapping.items()  # noqa: SLF001 (SQLAlchemy's public name)
    return {str(name): value for name, value in values if name != "number"}
