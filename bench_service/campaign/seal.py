"""The seal on an effect that is hidden in a simulated bench: shown closed, opened once, opened for all."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from bench_service.exchange.atomic import write_atomically
from bench_service.store.records import Json, utc_text


@dataclass(frozen=True, slots=True)
class Seal:
    """What is known of a hidden effect.

    Attributes
    ----------
    path : Path
        The file that the simulator has sealed the effect in.
    sha256 : str
        Of the contents: shown before, to be checked after.
    opened : dict or None
        ``effect``, ``value``, ``before``, ``unit``, ``contents`` and ``opened_utc`` once it is open.
    """

    path: Path
    sha256: str
    opened: Json | None

    @classmethod
    def read(cls, path: Path) -> Seal:
        """Read what the simulator has written."""
        document = json.loads(path.read_bytes())
        return cls(path, document["sha256"], _told(document) if document["opened_utc"] else None)

    def open(self) -> Seal:
        """Open it, on disk too, so that it stays open."""
        document = json.loads(self.path.read_bytes())
        document["opened_utc"] = document["opened_utc"] or utc_text(datetime.now(UTC))
        write_atomically(self.path, (json.dumps(document) + "\n").encode())
        return Seal.read(self.path)

    def to_json(self) -> Json:
        """Give the JSON object of the REST API."""
        return {"sha256": self.sha256, "opened": self.opened}


def _told(document: Json) -> Json:
    effect = document["effect"]
    sizes = {"effect": effect["name"], "value": effect["value"], "before": effect["before"]}
    return sizes | {name: document[name] for name in ("unit", "contents", "opened_utc")}
