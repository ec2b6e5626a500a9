"""What the REST API offers about files of other programs: uploaded, looked at, stored as runs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Unpack

from bench_service.client.connection import API, Connection, Record, part
from bench_service.client.model_calls import ModelCalls
from bench_service.client.waiting import Patience

_PIECE_BYTES = 1 << 20


class ImportCalls:
    """Part of a `BenchClient`.

    Parameters
    ----------
    connection : Connection
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._wait_job = ModelCalls(connection).wait_job

    def upload_file(self, path: Path | str, import_id: str | None = None) -> Record:
        """Upload a file of a cycler's program, or go on with a broken upload; give ``{"id", "name", "n_bytes"}``."""
        path = Path(path)
        if import_id is None:
            begun = self._connection.post(f"{API}/imports", {"name": path.name})
        else:
            begun = self._connection.get(f"{API}/imports/{part(import_id)}")
        address = f"{API}/imports/{part(begun['id'])}/content"
        offset = begun["n_bytes"]
        return self._connection.send("PUT", address, params={"offset": offset}, content=_pieces(path, offset)).json()

    def get_import(self, import_id: str) -> Record:
        """An upload: its name, and how many bytes of it are there."""
        return self._connection.get(f"{API}/imports/{part(import_id)}")

    def look_at_import(self, import_id: str, *, patience: Patience | None = None, **choices: Any) -> Record:
        """Look at an uploaded file: what its columns are taken for, why, and the question where something is unclear.

        `choices`: format, mapping, columns (role -> {"column", "unit"}), current_sign, date_order, time_zone, cell,
        leave_out.
        """
        job = self._connection.post(f"{API}/imports/{part(import_id)}/look", choices)
        return self._wait_job(job["id"], **(patience or {}))["result"]

    def store_import(
        self,
        import_id: str,
        capacity_Ah: float,
        initial_soc: float,
        *,
        name: str | None = None,
        cell_id: str | None = None,
        choices: Record | None = None,
        **patience: Unpack[Patience],
    ) -> Record:
        """Store an uploaded file as a run, wait for it, and give ``{"run", "state", "samples", ...}``."""
        body = {"capacity_Ah": float(capacity_Ah), "initial_soc": float(initial_soc), "name": name, "cell_id": cell_id}
        address = f"{API}/imports/{part(import_id)}/run"
        job = self._connection.post(address, body | {"choices": choices or {}})
        return self._wait_job(job["id"], **patience)["result"]

    def drop_import(self, import_id: str) -> Record:
        """Forget an uploaded file."""
        return self._connection.send("DELETE", f"{API}/imports/{part(import_id)}").json()

    def mappings(self) -> list[Record]:
        """Mappings of columns that are remembered."""
        return self._connection.get(f"{API}/mappings")["mappings"]

    def save_mapping(self, mapping: Record) -> Record:
        """Remember a mapping by the name in it."""
        return self._connection.post(f"{API}/mappings", mapping)


def _pieces(path: Path, offset: int) -> Iterator[bytes]:
    with path.open("rb") as stream:
        stream.seek(offset)
        while piece := stream.read(_PIECE_BYTES):
            yield piece
