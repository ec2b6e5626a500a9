"""What a worker does with a file that was sent to the service: look at it, or read it into a Parquet file beside it.

A question to a person is an answer here, not an error: the page shows it beside the columns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from bench_service.exchange.arrow_numbers import floats
from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.arrow_table import ArrowTable
from bench_service.exchange.foreign.guess import QuestionError
from bench_service.exchange.foreign.importing import Imported, import_file
from bench_service.exchange.foreign.looking import Choices, look, open_table
from bench_service.exchange.foreign.mapping import ROLES, Column, Mapping
from bench_service.exchange.foreign.output import write_imported
from bench_service.exchange.foreign.outside import Readers, readable
from bench_service.exchange.foreign.spool import Columns
from bench_service.exchange.foreign.text_table import TextTable
from bench_service.exchange.foreign.units import unit_names

_SHOWN_ROWS, _PLOTTED = 20, 600
Json = dict[str, Any]
Report = Callable[[float, str], None]


def choices_from_json(given: Json, mapping: Json | None) -> Choices:
    """Build a person's choices from the body of a request, and from a remembered mapping."""
    columns = {
        role: Column(str(each["column"]), each.get("unit")) for role, each in (given.get("columns") or {}).items()
    }
    return Choices(
        format=given.get("format"),
        mapping=None if mapping is None else Mapping.from_json(mapping, "mapping"),
        columns=columns,
        current_sign=given.get("current_sign"),
        date_order=given.get("date_order"),
        time_zone=given.get("time_zone"),
        cell=given.get("cell"),
        leave_out=bool(given.get("leave_out")),
    )


def look_at(report: Report, path: Path, title: str, given: Json, mapping: Json | None, readers: Readers) -> Json:
    """Look at a file and read it: what its columns are taken for, its first rows, a plot, and what is unclear."""
    told: Json = {"file": title, "state": "ok", "question": None, "asks": None, "roles": _roles()}
    try:
        choices = choices_from_json(given, mapping)
        with readable(path, title, readers) as source:
            told |= _table(open_table(source))
            told["mapping"] = look(source, choices).mapping.to_json()
            with closing(import_file(source, choices, lambda share: report(share, "reading"))) as run:
                return told | _read(run)
    except QuestionError as error:
        if error.mapping is not None:
            told["mapping"] = error.mapping.to_json()
        return told | {"state": "question", "question": _named(error, path, title), "asks": error.asks}
    except RunFileError as error:
        raise RunFileError(_named(error, path, title)) from error


def convert(report: Report, path: Path, title: str, given: Json, mapping: Json | None, readers: Readers) -> Json:
    """Read a file into `run.parquet` beside it; raises RunFileError, a question included."""
    try:
        choices = choices_from_json(given, mapping)
        with (
            readable(path, title, readers) as source,
            closing(import_file(source, choices, lambda share: report(0.8 * share, "reading"))) as run,
        ):
            write_imported(path.parent / "run.parquet", run)
            report(0.9, "storing")
            return {"name": title, "mapping": run.mapping.to_json()} | _read(run)
    except RunFileError as error:
        raise RunFileError(_named(error, path, title)) from error


def stored_blocks(path: Path) -> Iterator[Columns]:
    """Blocks of what `convert` has written, with time from 0."""
    # Lazy: pyarrow takes 40 ms.
    import pyarrow.parquet as pq

    first_s: float | None = None
    with pq.ParquetFile(path) as file:
        for batch in file.iter_batches(1 << 16):
            block = {name: floats(batch.column(name)) for name in batch.schema.names}
            first_s = float(block["time_s"][0]) if first_s is None else first_s
            block["time_s"] = block["time_s"] - first_s
            yield block


def _named(error: Exception, path: Path, title: str) -> str:
    return str(error).replace(str(path), title)


def _table(table: TextTable | ArrowTable) -> Json:
    return {
        "kind": table.kind,
        "mapping": None,
        "columns": list(table.names),
        "first_rows": [list(row) for row in table.sample[:_SHOWN_ROWS]],
    }


def _roles() -> Json:
    """What a column can hold, with the units that it can have."""
    return {role: [] if quantity is None else list(unit_names(quantity)) for role, quantity in ROLES.items()}


def _read(run: Imported) -> Json:
    """Figures of a run, and a plot of at most some hundred points of its columns."""
    step = max(1, run.spool.n // _PLOTTED)
    kept = np.flatnonzero(run.keep)[::step]
    plot: Json = {}
    for name in ("time_s", "current_A", "voltage_V", "temperature_degC"):
        if name in run.spool.names:
            values = run.spool.column(name)[kept]
            plot[name] = [None if np.isnan(value) else float(value) for value in values]
    steps_s = np.diff(run.spool.column("time_s", 0, 100_000))
    forward = steps_s[steps_s > 0]
    current = run.spool
    return {
        "samples": run.n,
        "remarks": list(run.remarks),
        "ignored_columns": list(run.ignored_columns),
        # Of the first row: a stored run counts from there.
        "started_unix_s": None if run.started_unix_s is None else run.started_unix_s + _first_s(run),
        "duration_s": _duration_s(run),
        "dt_s": float(np.median(forward)) if len(forward) else None,
        "current_A": [current.lowest["current_A"], current.highest["current_A"]],
        "voltage_V": [current.lowest["voltage_V"], current.highest["voltage_V"]],
        "plot": plot,
    }


def _first_s(run: Imported) -> float:
    first = int(np.argmax(run.keep))
    return float(run.spool.column("time_s", first, first + 1)[0])


def _duration_s(run: Imported) -> float:
    last = int(np.flatnonzero(run.keep)[-1])
    return float(run.spool.column("time_s", last, last + 1)[0]) - _first_s(run)
