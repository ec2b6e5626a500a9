"""That a run is played on the cell that is meant, and which cell a run of the past belongs to."""

from __future__ import annotations

from bench_service.bench.messages import EventMessage
from bench_service.campaign.benches import Bench
from bench_service.campaign.journal import Journal
from bench_service.errors import ConflictError
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunRecord


def check_cell(
    cell_id: str | None,
    bench: Bench,
    store: MetadataStore,
    *,
    continues: str | None = None,
    campaign_id: str | None = None,
) -> None:
    """Refuse a run where another cell is on the bench; reads the store, so it is called in a thread.

    Parameters
    ----------
    cell_id : str or None
        The cell that a client means; None: whichever is there.
    continues, campaign_id : str or None
        The run that it goes on with, and its campaign: both began on a cell.

    Raises
    ------
    ConflictError
        Another one is there.
    """
    there = None if bench.cell is None else bench.cell.id
    if cell_id is not None and cell_id.lower() != (there or "").lower():
        raise ConflictError(f"{_on(bench, there)}, not {cell_id}; put that one on it first", ("cell_id", cell_id))
    before: RunRecord | None = None
    if continues is not None:
        before = store.runs.get(continues)
    elif campaign_id is not None:
        before = next(iter(store.runs.page(bench=bench.name, campaign_id=campaign_id, limit=1)), None)
    if before is not None and before.cell_id != there:
        begun = "a cell that nobody has named" if before.cell_id is None else f"cell {before.cell_id}"
        raise ConflictError(f"{_on(bench, there)}, but it began on {begun} (run {before.id})", ("cell_id",))


async def give_run(store: MetadataStore, journal: Journal, run_id: str, cell_id: str | None) -> RunRecord:
    """Let a run of the past belong to a cell, or to none, and what was made from it; kept as an event.

    Raises
    ------
    NotFoundError
        Run or cell are not there.
    """
    before = store.runs.get(run_id)
    await journal.write(store.cells.give_run, run_id, cell_id)
    after = store.runs.get(run_id)
    if before.cell_id != after.cell_id:
        named = "no cell" if after.cell_id is None else f"cell {after.cell_id}"
        was = "" if before.cell_id is None else f", was of cell {before.cell_id}"
        text = f"{before.called} belongs to {named}{was}"
        event = EventMessage(severity="info", code="run_cell", text=text, run_id=run_id)
        journal.note(before.bench, event, None, after.cell_id or before.cell_id)
    return after


def known_cell(store: MetadataStore, cell_id: str | None) -> str | None:
    """Return the id of a cell as it is stored; raises `NotFoundError`."""
    return None if cell_id is None else store.cells.get(cell_id).id


def cell_of_all(store: MetadataStore, run_ids: list[str]) -> str | None:
    """Return the cell of runs that are to be one cell's; None where none of them has one.

    Raises
    ------
    ConflictError
        They are of several.
    NotFoundError
        A run is not there.
    """
    found = {cell_id for run_id in run_ids if (cell_id := store.runs.get(run_id).cell_id) is not None}
    if len(found) > 1:
        raise ConflictError(f"the runs are of several cells: {', '.join(sorted(found))}; follow one", ("run_ids",))
    return next(iter(found), None)


def _on(bench: Bench, there: str | None) -> str:
    return f"on bench {bench.name!r} there is {'no cell that is named' if there is None else f'cell {there}'}"
