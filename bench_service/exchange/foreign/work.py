"""What a worker does with a file that was sent to the service: look at it, or read it into a Parquet file beside it.

A question to a person is an answer here, not an error: the page shows it beside the columns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.guess import QuestionError
from bench_service.exchange.foreign.importing import Imported, import_file
from bench_service.exchange.foreign.looking import Choices, Look, look
from bench_service.exchange.foreign.mapping import Column, Mapping
from bench_service.exchange.foreign.output import write_imported
from bench_service.exchange.foreign.spool import Columns

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


def look_at(report: Report, path: Path, title: str, given: Json, mapping: Json | None) -> Json:
    """Look at a file and read it: what its columns are taken for, its first rows, a plot, and what is unclear."""
    choices = choices_from_json(given, mapping)
    told: Json = {"file": title, "state": "ok", "question": None, "asks": None}
    try:
        seen = look(path, choices)
        told |= _looked(seen)
        with closing(import_file(path, choices, lambda share: report(share, "reading"))) as run:
            return told | _read(run)
    except QuestionError as error:
        return told | {"state": "question", "question": _named(error, path, title), "asks": error.asks}
    except RunFileError as error:
        raise RunFileError(_named(error, path, title)) from error


def convert(report: Report, path: Path, title: str, given: Json, mapping: Json | None) -> Json:
    """Read a file into `run.parquet` beside it; raises RunFileError, a question included."""
    try:
        choices = choices_from_json(given, mapping)
        with closing(import_file(path, choices, lambda share: report(0.8 * share, "reading"))) as run:
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
            block = {
                name: np.asarray(batch.column(name).to_numpy(zero_copy_only=False), dtype=np.float64)
                for name in batch.schema.names
            }
            first_s = float(block["time_s"][0]) if first_s is None else first_s
            block["time_s"] = block["time_s"] - first_s
            yield block


def _named(error: Exception, path: Path, title: str) -> str:
    return str(error).replace(str(path), title)


def _looked(seen: Look) -> Json:
    return {
        "kind": seen.table.kind,
        "mapping": seen.mapping.to_json(),
        "columns": list(seen.table.names),
        "first_rows": [list(row) for row in seen.table.sample[:_SHOWN_ROWS]],
    }


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
        "started_unix_s": run.started_unix_s,
        "dt_s": float(np.median(forward)) if len(forward) else None,
        "current_A": [current.lowest["current_A"], current.highest["current_A"]],
        "voltage_V": [current.lowest["voltage_V"], current.highest["voltage_V"]],
        "plot": plot,
    }
