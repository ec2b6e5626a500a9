"""Measured runs of any program: read as they were looked at, mended where that is safe, asked about where it is not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.assemble import Cells, Wanted, assemble
from bench_service.exchange.foreign.byte_source import Progress
from bench_service.exchange.foreign.clean import is_time_in_step, judge_faults, keep_rows
from bench_service.exchange.foreign.guess import QuestionError, cells_of
from bench_service.exchange.foreign.looking import Choices, Look, look
from bench_service.exchange.foreign.mapping import Mapping
from bench_service.exchange.foreign.settle import settle_sign, settle_values
from bench_service.exchange.foreign.spool import SLICE, Columns, Spool
from bench_service.exchange.foreign.text_table import NotPlainNumberError
from bench_service.exchange.foreign.times import has_zone
from bench_service.exchange.foreign.units import CLOCK, EXCEL
from bench_service.streams import cell_number

# Columns of a run, in the order in which they are written.
RUN_COLUMNS = (
    "time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC", "soc_ref", "cycle_count", "step_count",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Imported:
    """A run as it was read; close its spool when done.

    Attributes
    ----------
    name : after the file
    mapping : which column held what, with reasons
    remarks : what a person should know, one line each
    ignored_columns : columns that were not used
    started_unix_s : UTC of the run's time 0 in s, or None where the file or its time zone does not tell
    n : rows that stay
    """

    name: str
    mapping: Mapping
    remarks: tuple[str, ...]
    ignored_columns: tuple[str, ...]
    started_unix_s: float | None
    n: int
    spool: Spool
    keep: NDArray[np.bool_]

    @property
    def names(self) -> tuple[str, ...]:
        """Own names of the run's columns, as they are written."""
        there = [name for name in RUN_COLUMNS if name in self.spool.names]
        cells = {number: name for name in self.spool.names if (number := cell_number(name)) is not None}
        there += [cells[number] for number in sorted(cells)]
        # A run has a temperature, be it unknown.
        needs_one = "temperature_degC" not in there and "ambient_degC" not in there
        return (*there[:3], "temperature_degC", *there[3:]) if needs_one else tuple(there)

    def blocks(self) -> Iterator[Columns]:
        """Own name -> (m,) of one stretch after the other."""
        for start, block in self.spool.slices(SLICE):
            kept = self.keep[start : start + SLICE]
            block.setdefault("temperature_degC", np.full(len(kept), np.nan))
            yield {name: block[name][kept] for name in self.names}

    def columns(self) -> Columns:
        """Own name -> (n,) of the whole run."""
        blocks = list(self.blocks())
        return {name: np.concatenate([block[name] for block in blocks]) for name in self.names}

    def close(self) -> None:
        """Remove the temporary files."""
        self.spool.close()


def import_file(path: Path, choices: Choices | None = None, progress: Progress = lambda _share: None) -> Imported:
    """Read a measured run of any known kind, in memory that does not grow with the file.

    Parameters
    ----------
    path : the file
    choices : what a person settles
    progress : called with the share done, 0..1

    Returns
    -------
    Imported

    Raises
    ------
    QuestionError
        Something is unclear: one line with the option that answers it.
    RunFileError
        The file cannot be used: one line.
    """
    choices = choices or Choices()
    seen = look(path, choices)
    remarks: list[str] = []
    spool, mapping = _read(seen, choices, remarks, lambda share: progress(0.8 * share))
    try:
        return _finish(seen, spool, mapping, choices, remarks, progress)
    except BaseException:
        spool.close()
        raise


def _finish(
    seen: Look, spool: Spool, mapping: Mapping, choices: Choices, remarks: list[str], progress: Progress
) -> Imported:
    where = str(seen.path)
    if spool.n == 0:
        raise RunFileError(f"{where}: has a header but no rows")
    started = _start(seen, spool, mapping, remarks)
    try:
        keep, faults = keep_rows(spool, seen.table.first_row, choices.leave_out)
        if is_time_in_step(faults) and "clock" in spool.names and "time_s" not in choices.columns:
            remarks.append(
                f"column {mapping.columns['time_s'].name!r} begins anew with each step: the date is taken for the time"
            )
            spool.drop("time_s")
            started = _start(seen, spool, mapping, [])
            keep, faults = keep_rows(spool, seen.table.first_row, choices.leave_out)
    except RunFileError as error:
        raise RunFileError(f"{where}: {error}") from error
    progress(0.9)
    remarks += judge_faults(where, faults, choices.leave_out)
    n = int(keep.sum())
    if n < 2:
        raise RunFileError(f"{where}: has {n} row(s); at least 2 are needed")
    settle_values(where, spool, mapping, remarks)
    settle_sign(where, spool, keep, mapping, remarks)
    progress(1.0)
    used = {column.name for column in mapping.columns.values()}
    ignored = tuple(name for name in seen.table.names if name not in used)
    return Imported(run_name(seen.path), mapping, tuple(remarks), ignored, started, n, spool, keep)


def run_name(path: Path) -> str:
    """Name of a run after its file, without the ends that tell the format."""
    name = path.name
    for suffix in (".gz", ".csv", ".txt", ".mpt", ".parquet", ".mat", ".ndax", ".nda", ".tsv", ".bdf"):
        name = name.removesuffix(suffix)
    return name or "run"


def _read(seen: Look, choices: Choices, remarks: list[str], progress: Progress) -> tuple[Spool, Mapping]:
    """Read all rows: quickly where numbers are written plainly, else with each cell cleaned."""
    for plain in (True, False):
        spool = Spool()
        try:
            return spool, _fill(seen, choices, spool, plain, remarks, progress)
        except NotPlainNumberError:
            spool.close()
        except BaseException:
            spool.close()
            raise
    raise RunFileError(f"{seen.path}: cannot be read")


def _fill(seen: Look, choices: Choices, spool: Spool, plain: bool, remarks: list[str], progress: Progress) -> Mapping:
    where, mapping = str(seen.path), seen.mapping
    wanted = Wanted.of(mapping, seen.table.names, where)
    cells, row = Cells({}), seen.table.first_row
    blocks = seen.table.read(list(wanted.numbers.values()), list(wanted.texts.values()), plain, remarks, progress)
    for block in blocks:
        columns, names = assemble(block, wanted, mapping, where, row)
        row += len(next(iter(columns.values())))
        if names is not None:
            cells.add(names)
            if choices.cell is not None:
                columns = {name: values[names == choices.cell] for name, values in columns.items()}
        spool.append(columns)
    if choices.cell is not None and spool.n == 0:
        there = ", ".join(cells.rows) or "no column that names cells; say which with --column cell=NAME"
        raise QuestionError(f"{where}: there is no cell {choices.cell!r}; the file has {there}", "cell")
    several = cells.several()
    if several and choices.cell is None:
        column = mapping.columns["cell"].name
        raise QuestionError(
            f"{where}: column {column!r} names {len(several)} cells ({', '.join(several[:8])}): choose one with "
            "--cell NAME, or --column cell= where they are one",
            "cell",
        )
    if choices.cell is None:
        mapping = replace(mapping, columns={k: each for k, each in mapping.columns.items() if k != "cell"})
    return mapping


def _start(seen: Look, spool: Spool, mapping: Mapping, remarks: list[str]) -> float | None:
    """Settle the run's time, and when it began; returns Unix time of the run's time 0 in s."""
    if "clock" not in spool.names:
        return None
    clock = spool.column("clock", 0, SLICE)
    known = np.flatnonzero(~np.isnan(clock))
    if "time_s" not in spool.names:
        if not len(known):
            raise RunFileError(f"{seen.path}: column {mapping.columns['clock'].name!r} holds no time")
        spool.derive("time_s", "clock", -float(clock[known[0]]))
    if not len(known):
        spool.drop("clock")
        return None
    k = int(known[0])
    first_s = float(clock[k] - spool.column("time_s", k, k + 1)[0])
    column = mapping.columns["clock"]
    if column.unit not in (CLOCK, EXCEL) or has_zone(cells_of(seen.table, column.name)[:20]):
        return first_s
    local = datetime.fromtimestamp(first_s, UTC).replace(tzinfo=None)
    if mapping.time_zone is None:
        remarks.append(
            f"it began at {local:%Y-%m-%d %H:%M:%S} by the clock of a computer whose time zone the file does not name: "
            "not kept; name it with --time-zone, as in Europe/Oslo"
        )
        return None
    return local.replace(tzinfo=ZoneInfo(mapping.time_zone)).timestamp()
