"""What the REST API offers about cells."""

from __future__ import annotations

from typing import Any

from bench_service.client.connection import API, Connection, Record, part


class CellCalls:
    """Part of a `BenchClient`.

    Parameters
    ----------
    connection : Connection
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def add_cell(self, **told: Any) -> Record:
        """Take a cell in: id, label, owner, type (as a cell-type file has it) or like (another cell's id), ..."""
        return self._connection.post(f"{API}/cells", told)

    def cell(self, cell_id: str) -> Record:
        """One cell: what it is, where it is and was, how much belongs to it."""
        return self._connection.get(f"{API}/cells/{part(cell_id)}")

    def change_cell(self, cell_id: str, **told: Any) -> Record:
        """Write label, owner, type, capacity_Ah or metadata of a cell; None takes it away."""
        return self._connection.send("PATCH", f"{API}/cells/{part(cell_id)}", json=told).json()

    def retire_cell(self, cell_id: str) -> Record:
        """Note that a cell is not used any more."""
        return self._connection.post(f"{API}/cells/{part(cell_id)}/retire")

    def reuse_cell(self, cell_id: str) -> Record:
        """Take a retired cell into use again."""
        return self._connection.post(f"{API}/cells/{part(cell_id)}/reuse")

    def cell_events(self, cell_id: str, limit: int | None = None) -> list[Record]:
        """What has happened to a cell, newest first."""
        return self._connection.get(f"{API}/cells/{part(cell_id)}/events", limit=limit)["events"]

    def put_cell(self, bench: str, cell_id: str | None) -> Record:
        """Say which cell is on a bench, or with None that none is; give the bench."""
        address = f"{API}/benches/{part(bench)}/cell"
        return self._connection.send("PUT", address, json={"cell_id": cell_id}, timeout=60.0).json()
