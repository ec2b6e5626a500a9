"""Whose report it is: what the store knows of the cell, the bench, the people and the dates behind some runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib.metadata import version

from bench_service.reports import words
from bench_service.reports.document import Heading
from bench_service.store.cells import CellRecord
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import IMPORTED, ModelRecord, RunRecord

_SHORT = 8  # letters of an id that people see
_MOST_RUNS = 6
_FROM_FILE = "none of this service: brought in from a file"


def heading_of(
    store: MetadataStore,
    kind: str,
    title: str,
    runs: Sequence[RunRecord],
    model_id: str | None = None,
    cell_id: str | None = None,
    more: Sequence[tuple[str, str]] = (),
) -> Heading:
    """Put the heading of a report together; reads the store.

    Parameters
    ----------
    kind, title : of the report
    runs : that it is about
    model_id : of the model that is used
    cell_id : where the runs do not say
    more : what else is to be told
    """
    model = None if model_id is None else store.models.get(model_id)
    cells = _each(run.cell_id for run in runs) or _each([cell_id, None if model is None else model.cell_id])
    told = [*more]
    if runs:
        shown = [run_name(run) for run in runs[:_MOST_RUNS]]
        rest = [f"{len(runs) - _MOST_RUNS} more"] if len(runs) > _MOST_RUNS else []
        told.insert(0, ("Run" if len(runs) == 1 else "Runs", words.listed([*shown, *rest])))
    return Heading(
        kind=kind,
        title=title,
        cell=words.listed([_cell_name(store.cells.get(each)) for each in cells]) or None,
        bench=words.listed(_each(_FROM_FILE if run.bench == IMPORTED else run.bench for run in runs)) or None,
        operator=words.listed(_each(run.operator for run in runs)) or None,
        dates=_dates(runs),
        model=None if model is None else model_name(model),
        more=told,
    )


def _dates(runs: Sequence[RunRecord]) -> str | None:
    """When runs were measured; of a file that does not tell it, only when it was brought in is known."""
    undated = [run for run in runs if run.bench == IMPORTED and run.started_utc is None]
    told = [run for run in runs if run not in undated]
    measured = words.span([each for run in told for each in (run.started_utc or run.created_utc, run.ended_utc)])
    came = words.span([run.created_utc for run in undated])
    return measured if came is None else "; ".join(filter(None, (measured, f"brought in {came}, its file has no date")))


def design_heading(store: MetadataStore, name: str, model_id: str | None, bench: str | None = None) -> Heading:
    """Return the heading of a design that is about to be made; reads the store."""
    model = None if model_id is None else store.models.get(model_id)
    cell = None if model is None or model.cell_id is None else store.cells.get(model.cell_id).called
    told = "none yet" if model is None else model_name(model)
    return Heading(
        "Design", name, cell, bench, None, "a plan, not played yet", told, (), words.made_by(version("bench-service"))
    )


def run_name(run: RunRecord) -> str:
    """What people call a run, with enough of its id to find it."""
    called = run.label or run.name
    return f"{called} ({run.id[:_SHORT]})" if called else run.id[:_SHORT]


def model_name(model: ModelRecord) -> str:
    """What people call a model, with enough of its id to find it, and when it was made."""
    return f"{model.name} ({model.id[:_SHORT]}), made {words.moment(model.created_utc)}"


def run_names(runs: Iterable[RunRecord]) -> dict[str, str]:
    """What people call runs, by their ids."""
    return {run.id: run_name(run) for run in runs}


def _cell_name(cell: CellRecord) -> str:
    kind = cell.type or {}
    made = " ".join(str(kind[key]) for key in ("maker", "model") if kind.get(key))
    owner = f"; owner: {cell.owner}" if cell.owner else ""
    return f"{cell.called}{f', {made}' if made else ''}{owner}"


def _each(values: Iterable[str | None]) -> list[str]:
    return list(dict.fromkeys(value for value in values if value))
