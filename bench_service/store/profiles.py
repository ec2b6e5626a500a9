"""Current profiles of one data directory."""

import uuid
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select

from bench_service.store import rows, schema
from bench_service.store.access import MetadataFile
from bench_service.store.records import ProfileRecord


class ProfileTable:
    """Stores profiles and finds them; see `MetadataStore`."""

    def __init__(self, file: MetadataFile, now: Callable[[], str]) -> None:
        self._file = file
        self._now = now

    def add(self, name: str, time_s: NDArray[np.float64], current_A: NDArray[np.float64]) -> ProfileRecord:
        """Store a checked profile: a current holds from its time to the next, the last row ends the profile."""
        record, row = rows.new_profile(uuid.uuid4().hex, name, time_s, current_A, self._now())
        self._file.insert(schema.profile, row)
        return record

    def get(self, profile_id: str) -> ProfileRecord:
        """Return a profile without its points."""
        return rows.profile(self._file.one(schema.profile, rows.PROFILE, profile_id))

    def points(self, profile_id: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return times in s and currents in A of a profile, each of shape (n,)."""
        return rows.checked_points(self._file.one(schema.profile, select(schema.profile), profile_id))

    def page(self, limit: int = 100, offset: int = 0, after: int | None = None) -> list[ProfileRecord]:
        """Return profiles without their points."""
        return [rows.profile(row) for row in self._file.page(schema.profile, rows.PROFILE, limit, offset, after)]
