"""The client's calls about long lists: all of it, page by page, or the newest."""

from __future__ import annotations

from collections.abc import Iterator

from bench_service.client.connection import API, Connection, Record, part


class ListCalls:
    """Calls about lists; `BenchClient` hands them on."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def every(self, kind: str, **filters: object) -> Iterator[Record]:
        """Go through a whole list, newest first, page by page; what comes meanwhile is not in it.

        `kind`: cells, runs, models, comparisons, diagnoses, profiles, protocols, campaigns or events. Filters are those
        of the list; `limit` is the size of a page.
        """
        asked: dict[str, object] = {"limit": 1000} | filters
        while True:
            page = self._connection.get(f"{API}/{part(kind)}", **asked)
            yield from page[kind]
            asked["cursor"] = page["next_cursor"]
            if asked["cursor"] is None:
                return

    def cells(self, q: str | None = None, *, retired: bool = False, limit: int = 1000) -> Iterator[Record]:
        """Go through the cells, newest first; with `q` those in whose texts each word is."""
        return self.every("cells", q=q, retired=retired, limit=limit)

    def runs(self, **filters: object) -> list[Record]:
        """Runs, newest first; filters are bench, state, campaign_id, cell_id, q (words), limit, offset."""
        return self._connection.get(f"{API}/runs", **filters)["runs"]

    def events(self, run_id: str | None = None, limit: int | None = None) -> list[Record]:
        """Events of a run, or the latest of all."""
        address = f"{API}/events" if run_id is None else f"{API}/runs/{part(run_id)}/events"
        return self._connection.get(address, limit=limit)["events"]
