"""What a cell makes of the bench that it stands on: the tighter limits of both hold, and its capacity counts."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from bench_service.bench.limits import Limits
from bench_service.campaign.chambers import chamber_settings
from bench_service.config import BenchConfig, CellTypeConfig
from bench_service.errors import BadRequestError
from bench_service.store.cells import CellRecord
from bench_service.store.records import Json


def cell_type_of(document: Json | None) -> CellTypeConfig | None:
    """Read the type in a cell's record, or in a request; None where there is none.

    Raises
    ------
    BadRequestError
        It is no cell type; the message names the key.
    """
    if document is None:
        return None
    try:
        return CellTypeConfig.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        reason = "unknown key" if first["type"] == "extra_forbidden" else first["msg"].removeprefix("Value error, ")
        where = ("type", *first["loc"])
        raise BadRequestError(f"{'.'.join(str(part) for part in where)}: {reason}", where) from error


def capacity_of(cell: CellRecord) -> float | None:
    """Return what a cell holds, in Ah: as measured, else as its type says; None where nobody knows."""
    return cell.capacity_Ah or (None if cell.type is None else float(cell.type["capacity_Ah"]))


def with_cell(config: BenchConfig, cell: CellRecord | None) -> BenchConfig:
    """Return the configuration of a bench with a cell on it.

    A simulated cell holds what it is simulated with, whatever the record says of its capacity.

    Raises
    ------
    BadRequestError
        The limits of both leave nothing, or the record's type is none.
    """
    if cell is None:
        return config
    kind, capacity_Ah = cell_type_of(cell.type), capacity_of(cell)
    changes: dict[str, Any] = {} if kind is None else {"cell_type": kind, "limits": _tighter(config, kind, cell)}
    if capacity_Ah is not None and config.simulate is None:
        changes["capacity_Ah"] = capacity_Ah
    if kind is not None and config.chamber is not None and config.chamber.temperature_degC is not None:
        window = _both(config.chamber.temperature_degC, kind.temperature_degC)
        if not window[0] < window[1]:
            raise _nothing_left(cell, "the chamber's temperature_degC")
        changes["chamber"] = config.chamber.model_copy(update={"temperature_degC": window})
    return config.model_copy(update=changes)


def settings_with(config: BenchConfig, chamber_url: str | None) -> dict[str, Any]:
    """Return what a control process is told of a bench with its cell: fields of `BenchSettings`."""
    return {
        "limits": Limits.from_json(config.limits.model_dump()),
        "capacity_Ah": config.capacity_Ah,
        "resistance_Ohm": None if config.cell_type is None else config.cell_type.resistance_Ohm,
        "chamber": chamber_settings(config, chamber_url),
    }


def _tighter(config: BenchConfig, kind: CellTypeConfig, cell: CellRecord) -> Any:
    windows = {name: _both(getattr(config.limits, name), window) for name, window in kind.limits.items()}
    for name, (low, high) in windows.items():
        if not low < high:
            raise _nothing_left(cell, f"limits.{name}")
    return config.limits.model_copy(update=windows)


def _both(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    return max(one[0], other[0]), min(one[1], other[1])


def _nothing_left(cell: CellRecord, what: str) -> BadRequestError:
    text = f"cell {cell.called} cannot be on this bench: {what} of bench and cell have nothing in common"
    return BadRequestError(text, ("cell_id", cell.id), remedy="correct the cell's type, or choose another bench")
