"""Whether a bench must wait for a person, told by what is stored; the order of events counts, never a clock."""

from __future__ import annotations

from typing import get_args

from bench_service.bench.latch import Latch, LatchCode
from bench_service.campaign.benches import ACKNOWLEDGED, LATCHED
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunRecord

# The first one is that of earlier versions.
_LATCHES = {LATCHED: "unknown", **{f"{LATCHED}_{code}": code for code in get_args(LatchCode)}}
_BAD_ENDS = ("run_fault", "run_interrupted", "service_restarted")


def unacknowledged(store: MetadataStore, bench: str) -> Latch | None:
    """Return why the bench must wait for an operator: its last run ended badly, or a fault came, and nobody has looked.

    Control processes forget with their end; a fault must not vanish because the service was restarted, nor because
    somebody has set the clock back.
    """
    seen = store.events.last((ACKNOWLEDGED,), bench=bench)
    last_seen = 0 if seen is None else seen.id
    last = next(iter(store.runs.page(bench=bench, limit=1)), None)
    left = None
    if last is not None:
        left = Latch.of_run(last.state, last.reason, f"run {last.id} ended as {last.state}: {last.reason}")
        left = left if left is not None and _came_after(store, last, last_seen) else None
    latched = store.events.last(tuple(_LATCHES), bench=bench)
    if latched is None or latched.id < last_seen:
        return left
    return Latch(_LATCHES[latched.code], latched.text).over(left)


def _came_after(store: MetadataStore, run: RunRecord, event_id: int) -> bool:
    """Whether the bad end of a run came after an event; one that never began has none."""
    if store.events.last(("refused",), run_id=run.id) is not None:
        return False
    end = store.events.last(_BAD_ENDS, run_id=run.id)
    if end is None:  # the service died before it had written of it
        end = store.events.last(None, run_id=run.id)
    return event_id == 0 or (end is not None and end.id > event_id)
