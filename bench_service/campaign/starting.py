"""Runs that are being started: a stop that comes before a run has an id is for them too."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(slots=True, eq=False)
class Start:
    """A run that is being checked and written down, and why it is to end before it has begun; None: it is not."""

    bench: str
    stop: str | None = None


class Starts:
    """All runs that are being started."""

    def __init__(self) -> None:
        self._now: list[Start] = []

    @contextlib.contextmanager
    def one(self, bench: str) -> Iterator[Start]:
        """Count a run as being started on a bench meanwhile."""
        start = Start(bench)
        self._now.append(start)
        try:
            yield start
        finally:
            self._now.remove(start)

    def stop(self, bench: str, reason: str) -> None:
        """Have whatever is being started on a bench end before its first tick."""
        for start in self._now:
            if start.bench == bench:
                start.stop = start.stop or reason
