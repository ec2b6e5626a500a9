"""Devices of one data directory: which was seen on a bench since when."""

from collections.abc import Callable
from typing import Any

from sqlalchemy import Row, select

from bench_service.store import schema
from bench_service.store.access import MetadataFile


class DeviceTable:
    """Stores which devices were seen on the benches; see `MetadataStore`."""

    def __init__(self, file: MetadataFile, now: Callable[[], str]) -> None:
        self._file = file
        self._now = now

    def see(self, bench: str, identity: dict[str, str]) -> None:
        """Note what the device on a bench says of itself; what is known already is not written again."""
        if self.last(bench) != identity:
            values = {"bench": bench, "identity": identity, "since_utc": self._now()}
            self._file.insert(schema.device, values)

    def last(self, bench: str) -> dict[str, str] | None:
        """Return what the device has said of itself that was last seen on a bench; None where none ever was."""
        table = schema.device
        query = select(table.c.identity).where(table.c.bench == bench).order_by(table.c.id.desc()).limit(1)
        with self._file.read() as link:
            row: Row[Any] | None = link.execute(query).one_or_none()
        return None if row is None else dict(row.identity)
