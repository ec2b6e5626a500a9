"""Tickets to the benches' stop ports: files that only their owner may read, and what can be asked with them.

Standard library only: who wants to stop a bench must not wait for imports.
"""

from __future__ import annotations

import contextlib
import http.client
import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

FOLDER = "stop"  # in the data directory
LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})


@dataclass(frozen=True, slots=True)
class StopTicket:
    """Where a bench's control process listens on this machine, and the token that it wants."""

    bench: str
    url: str
    token: str

    def ask(self, operation: str, reason: str = "", timeout_s: float = 1.0) -> dict[str, Any]:
        """Send ``stop``, ``acknowledge`` or ``state``; give the answer: bench, state, run_id.

        Raises
        ------
        OSError
            The control process does not answer, or refuses.
        """
        at = urlsplit(self.url)
        connection = http.client.HTTPConnection(at.hostname or "", at.port, timeout=timeout_s)
        try:
            connection.request("POST", f"/{operation}", f"{self.token}\n{reason}")
            answer = connection.getresponse()
            content = json.loads(answer.read())
        except (http.client.HTTPException, ValueError) as error:
            raise OSError(f"{self.url}: no answer of a stop port: {error!r}") from error
        finally:
            connection.close()
        if answer.status != 200:
            raise OSError(f"{self.url}: {content.get('error', answer.status)}")
        return content


def write_ticket(data_dir: Path, ticket: StopTicket) -> Path:
    """Write a ticket, which takes the place of an earlier one, and give its file."""
    folder = data_dir / FOLDER
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder.chmod(0o700)
    path = folder / f"{ticket.bench}.json"
    new = path.with_suffix(".new")
    with contextlib.suppress(OSError):
        new.unlink()
    # Created with its final rights: at no moment can somebody else open it.
    descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        json.dump(asdict(ticket), file)
    new.rename(path)
    return path


def read_tickets(data_dir: Path) -> Iterator[StopTicket]:
    """Give the tickets of a data directory; what cannot be read is passed over."""
    for path in sorted((data_dir / FOLDER).glob("*.json")):
        with contextlib.suppress(OSError, ValueError, TypeError):
            yield StopTicket(**json.loads(path.read_text(encoding="utf-8")))


def is_local(url: str) -> bool:
    """Whether a service's address is on this machine, where its stop ports are."""
    return urlsplit(url).hostname in LOCAL_NAMES
