"""Cells: taken in, described, put on benches and taken off; each change is kept as an event."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import asdict, replace

from bench_service.bench.messages import EventMessage
from bench_service.campaign.benches import Bench, Benches
from bench_service.campaign.campaigns import CampaignRunner
from bench_service.campaign.cell_on_bench import cell_type_of, settings_with, with_cell
from bench_service.campaign.journal import Journal
from bench_service.campaign.runs import Runs
from bench_service.errors import BenchBusyError
from bench_service.store.cells import CellRecord
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import Json

_BACK_S = 15.0
_SHOWN = 80  # of a long value, in an event


class Cells:
    """Keeps cells, and knows which stands on which bench.

    Parameters
    ----------
    store, journal, benches, runs, campaigns
    """

    def __init__(
        self, store: MetadataStore, journal: Journal, benches: Benches, runs: Runs, campaigns: CampaignRunner
    ) -> None:
        self._store, self._journal = store, journal
        self._benches, self._runs, self._campaigns = benches, runs, campaigns

    async def add(self, told: Json, like: str | None = None) -> Json:
        """Take a cell in; `told` are fields of `CellRecord`, `like` names a cell of the same type.

        Raises
        ------
        BadRequestError
            Its type is none.
        ConflictError, NotFoundError
            The id is taken, or the other cell is not there.
        """
        if like is not None:
            told = told | {"type": (await asyncio.to_thread(self._store.cells.get, like)).type}
        told = told | {"type": _plain_type(told.get("type"))}
        cell_id = told.pop("id", None)
        cell = await self._journal.write(lambda: self._store.cells.add(cell_id, **told))
        self._note(cell, "cell_added", f"cell {cell.called} is taken in")
        return await asyncio.to_thread(self.to_json, cell)

    async def change(self, cell_id: str, told: Json) -> Json:
        """Write other values down; raises as `add`, and where the bench that it stands on cannot take them."""
        if "type" in told:
            told = told | {"type": _plain_type(told["type"])}
        before = await asyncio.to_thread(self._store.cells.get, cell_id)
        changes = {name: value for name, value in told.items() if value != getattr(before, name)}
        if not changes:
            return await asyncio.to_thread(self.to_json, before)
        bench = next((each for each in self._benches if each.cell is not None and each.cell.id == before.id), None)
        with contextlib.ExitStack() as held:
            if bench is not None and {"type", "capacity_Ah"} & set(changes):
                with_cell(bench.base, replace(before, **changes))
                held.enter_context(self._free(bench))
            _, cell = await self._journal.write(self._store.cells.change, before.id, changes)
            if bench is not None:
                await self._carry(bench, cell, bench.cell_since_utc)
        words = [f"{name} {_short(value)}, was {_short(getattr(before, name))}" for name, value in changes.items()]
        self._note(cell, "cell_changed", f"cell {cell.called}: {'; '.join(words)}")
        return await asyncio.to_thread(self.to_json, cell)

    async def retire(self, cell_id: str, *, used_again: bool = False) -> Json:
        """Note that a cell is not used any more, or is again; raises `ConflictError` where it stands on a bench."""
        before = await asyncio.to_thread(self._store.cells.get, cell_id)
        cell = await self._journal.write(lambda: self._store.cells.retire(cell_id, used_again=used_again))
        if (before.retired_utc is None) != (cell.retired_utc is None):
            word = "is used again" if used_again else "is retired"
            self._note(cell, "cell_used_again" if used_again else "cell_retired", f"cell {cell.called} {word}")
        return await asyncio.to_thread(self.to_json, cell)

    async def put(self, name: str, cell_id: str | None) -> Json:
        """Put a cell on a bench, or with None take off what is there; the control process begins anew with its limits.

        Raises
        ------
        NotFoundError
            No such bench or cell.
        BenchBusyError, ConflictError
            A run or a campaign is on the bench; the cell is retired or on another bench.
        BadRequestError
            The limits of both have nothing in common.
        """
        bench = self._benches.get(name)
        cell = None if cell_id is None else await asyncio.to_thread(self._store.cells.get, cell_id)
        with_cell(bench.base, cell)
        before = bench.cell
        if (None if cell is None else cell.id) == (None if before is None else before.id):
            return bench.to_json()
        with self._free(bench):
            place = await self._journal.write(self._store.cells.put, name, None if cell is None else cell.id)
            await self._carry(bench, cell, place.since_utc)
        if before is not None:
            self._note(before, "cell_off_bench", f"cell {before.called} is taken off bench {name!r}", name)
        if cell is not None:
            self._note(cell, "cell_on_bench", f"cell {cell.called} is put on bench {name!r}", name)
        return bench.to_json()

    def to_json(self, cell: CellRecord) -> Json:
        """Give the JSON object of the REST API; reads the store."""
        return self.all_to_json([cell])[0]

    def all_to_json(self, cells: list[CellRecord]) -> list[Json]:
        """Give the JSON objects of several."""
        ids = [cell.id for cell in cells]
        counts, on = self._store.cells.counts(ids), self._store.cells.benches(ids)
        return [asdict(cell) | counts[cell.id] | {"bench": on.get(cell.id)} for cell in cells]

    def _free(self, bench: Bench) -> contextlib.AbstractContextManager[None]:
        if self._campaigns.is_running(bench.name):
            raise BenchBusyError(f"bench {bench.name!r} is busy with a campaign; stop it or wait")
        return self._runs.claimed(bench)

    async def _carry(self, bench: Bench, cell: CellRecord | None, since_utc: str | None) -> None:
        before = settings_with(bench.config, bench.chamber_url)
        bench.carry(cell, since_utc)
        if (changed := settings_with(bench.config, bench.chamber_url)) != before:
            await renewed(bench, changed)
        self._benches.publish(bench)

    def _note(self, cell: CellRecord, code: str, text: str, bench: str | None = None) -> None:
        event = EventMessage(severity="info", code=code, text=text, run_id=None)
        self._journal.note(bench, event, None, cell.id)


async def renewed(bench: Bench, settings: Json) -> None:
    """Have a bench's control process begin anew with other settings, and wait a while until it is back."""
    supervisor = bench.supervisor
    was_there = supervisor.status.state != "offline"
    pid = supervisor.pid
    supervisor.renew(**settings)
    if not was_there or pid is None:
        return
    loop = asyncio.get_running_loop()
    deadline_s = loop.time() + _BACK_S
    while loop.time() < deadline_s:
        if supervisor.pid not in (None, pid) and supervisor.status.state != "offline":
            return
        await asyncio.sleep(0.05)


def cell_on(store: MetadataStore, bench: str) -> tuple[CellRecord | None, str | None]:
    """Return which cell stands on a bench, and since when it does, or the bench is empty; reads the store."""
    place = store.cells.place(bench)
    if place is None:
        return None, None
    return None if place.cell_id is None else store.cells.get(place.cell_id), place.since_utc


def _plain_type(document: Json | None) -> Json | None:
    kind = cell_type_of(document)
    return None if kind is None else kind.model_dump(mode="json")


def _short(value: object) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]} ..."
