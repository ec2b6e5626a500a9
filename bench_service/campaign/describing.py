"""What people write about runs: kept with the run, each change as an event that tells what stood there before."""

from __future__ import annotations

from bench_service.bench.messages import EventMessage
from bench_service.campaign.journal import Journal
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunRecord

_SHOWN = 80  # of a long text, in an event


async def describe_run(store: MetadataStore, journal: Journal, run_id: str, told: dict[str, str | None]) -> RunRecord:
    """Write down label, operator or notes of a run; raises `NotFoundError`."""
    before, after = await journal.write(store.runs.describe, run_id, told)
    changes = [_change(name, getattr(before, name), value) for name, value in told.items()]
    if changed := [change for change in changes if change is not None]:
        text = f"{before.called}: {'; '.join(changed)}"
        journal.note(before.bench, EventMessage(severity="info", code="run_described", text=text, run_id=run_id))
    return after


def _change(name: str, before: str | None, after: str | None) -> str | None:
    if before == after:
        return None
    was = "" if before is None else f", was {_short(before)}"
    return f"{name} taken away{was}" if after is None else f"{name} {_short(after)}{was}"


def _short(text: str) -> str:
    line = " ".join(text.split())
    return repr(line if len(line) <= _SHOWN else f"{line[:_SHOWN]} ...")
