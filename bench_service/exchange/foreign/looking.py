"""Look at a file: which table it holds, and what its columns are taken for."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from bench_service.exchange.foreign.arrow_table import ArrowTable, open_mat, open_mdf, open_neware, open_parquet
from bench_service.exchange.foreign.cyclers import cycler_map, recognise
from bench_service.exchange.foreign.guess import QuestionError, cells_of, guess, resolve
from bench_service.exchange.foreign.mapping import Column, Mapping
from bench_service.exchange.foreign.signatures import kind_of
from bench_service.exchange.foreign.text_table import TextTable, open_text
from bench_service.exchange.foreign.times import date_order
from bench_service.exchange.foreign.units import CLOCK

_NEEDED = ("voltage_V", "current_A")


@dataclass(frozen=True, slots=True)
class Choices:
    """What a person settles; everything else is guessed.

    Attributes
    ----------
    format : name of a cycler's map; None: recognised
    mapping : one that was remembered; None: guessed
    columns : role -> column in place of the guessed one; a name "" takes the role away
    current_sign, date_order, time_zone : as in `Mapping`
    cell : which cell of a file with several
    leave_out : rows whose time lies before that of an earlier one are left out
    """

    format: str | None = None
    mapping: Mapping | None = None
    columns: dict[str, Column] = field(default_factory=dict)
    current_sign: str | None = None
    date_order: str | None = None
    time_zone: str | None = None
    cell: str | None = None
    leave_out: bool = False


@dataclass(frozen=True, slots=True)
class Look:
    """A file as it was looked at: its table and what its columns are taken for."""

    path: Path
    table: TextTable | ArrowTable
    mapping: Mapping


def look(path: Path, choices: Choices | None = None) -> Look:
    """Look at a file and guess its mapping.

    Raises
    ------
    QuestionError
        A needed column is not found, or two fit: with the option that answers it.
    RunFileError
        No table, or nothing that is read here.
    """
    choices = choices or Choices()
    table = open_table(path)
    where = str(path)
    settled = {
        role: column if column.name == "" else resolve(table, role, column, where)
        for role, column in choices.columns.items()
    }
    if choices.mapping is not None:
        mapping = choices.mapping
    else:
        known = recognise(table.names) if choices.format is None else cycler_map(choices.format, where)
        mapping = guess(table, known, where, tuple(settled))
    mapping = mapping.corrected(
        settled, current_sign=choices.current_sign, date_order=choices.date_order, time_zone=choices.time_zone
    )
    try:
        _check_complete(where, table, mapping)
        return Look(path, table, _settle_dates(where, table, mapping))
    except QuestionError as error:
        error.mapping = mapping
        raise


def open_table(path: Path) -> TextTable | ArrowTable:
    """Open what reads a file; raises RunFileError where nothing does."""
    kind = kind_of(path)
    if kind == "parquet":
        return open_parquet(path)
    if kind == "neware":
        return open_neware(path)
    if kind == "mat":
        return open_mat(path)
    if kind == "mdf":
        return open_mdf(path)
    return open_text(path)


def _check_complete(where: str, table: TextTable | ArrowTable, mapping: Mapping) -> None:
    missing = [role for role in _NEEDED if role not in mapping.columns]
    if "charge_current_A" in mapping.columns or "discharge_current_A" in mapping.columns:
        missing = [role for role in missing if role != "current_A"]
    if "time_s" not in mapping.columns and "clock" not in mapping.columns:
        missing.insert(0, "time_s")
    if missing:
        there = ", ".join(map(repr, table.names[:20])) + (", ..." if len(table.names) > 20 else "")
        options = " ".join(f"--column {role}=NAME" for role in missing)
        raise QuestionError(
            f"{where}: which column holds {', '.join(missing)}? Say it with {options} (NAME:UNIT where the name tells "
            f"no unit); the file has {there}",
            missing[0],
        )


def _settle_dates(where: str, table: TextTable | ArrowTable, mapping: Mapping) -> Mapping:
    """Ask for the order of day and month only where the time hangs on it; without it no start is known."""
    clock = mapping.columns.get("clock")
    if clock is None or clock.unit != CLOCK or mapping.date_order is not None or clock.name not in table.names:
        return mapping
    told = date_order(cells_of(table, clock.name))
    if told is not None:
        return replace(mapping, date_order=told)
    if "time_s" in mapping.columns:
        return replace(mapping, columns={role: each for role, each in mapping.columns.items() if role != "clock"})
    first = next(iter(cells_of(table, clock.name)), "")
    raise QuestionError(
        f"{where}: is {first!r} in column {clock.name!r} written day first or month first? Say it with --date-order "
        "day-first or month-first",
        "date_order",
    )
