"""Which cell a result belongs to: that of the runs which it was made from, where they all are of one."""

from collections.abc import Sequence

from sqlalchemy import Connection, select, update

from bench_service.errors import NotFoundError
from bench_service.store import schema
from bench_service.store.access import MetadataFile
from bench_service.store.records import Json, RunReference

# What a result was made from, by table; where nothing is named the model's cell counts.
_MADE_FROM = ((schema.model, "train"), (schema.comparison, "runs"), (schema.diagnosis, "runs"))


def cell_of_runs(file: MetadataFile, runs: Sequence[RunReference]) -> str | None:
    """Return the one cell that all these runs belong to; None where there is none, or several."""
    with file.read() as link:
        return _cell_of(link, [each.run_id for each in runs])


def give_run(file: MetadataFile, run_id: str, cell_id: str | None) -> None:
    """Let a run belong to a cell, or to none; models, comparisons and diagnoses made from it follow.

    Raises
    ------
    NotFoundError
        There is no such run.
    """
    run = schema.run
    with file.write() as link:
        if not link.execute(update(run).where(run.c.id == run_id).values(cell_id=cell_id)).rowcount:
            raise NotFoundError.of("run", run_id)
        for table, column in _MADE_FROM:
            for row in link.execute(select(table.c.id, table.c[column].label("made_from"))).all():
                named = _ids(row.made_from)
                if run_id in named:
                    link.execute(update(table).where(table.c.id == row.id).values(cell_id=_cell_of(link, named)))


def _ids(references: list[Json]) -> list[str]:
    return [each["run_id"] for each in references]


def _cell_of(link: Connection, run_ids: Sequence[str]) -> str | None:
    run = schema.run
    found = link.execute(select(run.c.cell_id).where(run.c.id.in_(run_ids)).distinct()).scalars().all()
    return found[0] if len(found) == 1 else None
