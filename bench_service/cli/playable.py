"""What `run` plays: a profile or a protocol, from a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from bench_service.client import BenchClient
    from bench_service.client.run_options import RunOptions
    from bench_service.exchange.profile import ProfileFile


class Playable(Protocol):
    """A file that can be played."""

    @property
    def name(self) -> str:
        """Name of the run."""
        ...

    @property
    def shortest_s(self) -> float:
        """Shortest time that a sampling time should not be longer than."""
        ...

    def upload(self, client: BenchClient, bench: str) -> tuple[str | None, RunOptions]:
        """Store it; return the profile's id, or None and the protocol's among the options of a run."""
        ...


@dataclass(frozen=True, slots=True)
class _Profile:
    file: ProfileFile

    @property
    def name(self) -> str:
        return self.file.name

    @property
    def shortest_s(self) -> float:
        return float((self.file.time_s[1:] - self.file.time_s[:-1]).min())

    def upload(self, client: BenchClient, bench: str) -> tuple[str | None, RunOptions]:
        stored = client.upload_profile(self.name, self.file.time_s.tolist(), self.file.current_A.tolist())
        return stored["id"], {}


@dataclass(frozen=True, slots=True)
class _Protocol:
    document: dict[str, Any]
    name: str
    shortest_s: float

    def upload(self, client: BenchClient, bench: str) -> tuple[str | None, RunOptions]:
        return None, {"protocol_id": client.upload_protocol(self.document, bench)["id"]}


def read_playable(path: Path) -> Playable:
    """Read a profile (CSV) or a protocol (JSON).

    Raises
    ------
    ProfileFileError, ProtocolError
        It cannot be played; the message says what and where.
    """
    if not path.name.endswith(".json"):
        # Lazy: numpy and pyarrow take 150 ms.
        from bench_service.exchange.profile import read_profile

        return _Profile(read_profile(path))
    document = read_protocol_file(path)
    from bench_service.protocol.document import read_protocol

    protocol = read_protocol(document)
    return _Protocol(document, protocol.name, _shortest_s(document))


def read_protocol_file(path: Path) -> dict[str, Any]:
    """Return the document in a file, of our own schema; raises `UsageError` or `ProtocolError`."""
    from bench_service.cli.errors import UsageError
    from bench_service.protocol.formats.reading import parse_document

    try:
        content = path.read_bytes()
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error
    return parse_document(content)


def _shortest_s(document: Any) -> float:
    """Return the shortest record time, or time of a pulse, in a document."""
    found = [float("inf")]
    if isinstance(document, dict):
        record = document.get("record")
        rule_s = record.get("time_s") if isinstance(record, dict) else None
        times = [rule_s, document.get("on_s"), document.get("off_s")]
        found += [float(value) for value in times if isinstance(value, int | float) and value > 0]
        for step in document.get("steps") or []:
            found.append(_shortest_s(step))
    return min(found)
