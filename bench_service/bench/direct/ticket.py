"""What is needed to use a bench's stop port: its address and token, in a file that only its owner may read."""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import socket
from pathlib import Path

FOLDER = "stop"  # in the data directory
_BACKLOG = 128


class StopEndpoint:
    """The API process's end of a bench's stop port: listens before there is a control process, and hands that on.

    Attributes
    ----------
    listener : socket.socket
        To be inherited by the control process. Kept open here too, so that a restarted one has the same port.
    url, token : str
    origins : tuple of str
    """

    def __init__(self, data_dir: Path, bench: str, origins: tuple[str, ...] = ()) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0), backlog=_BACKLOG)
        self.url = f"http://127.0.0.1:{self.listener.getsockname()[1]}"
        self.token = secrets.token_urlsafe(24)
        self.origins = origins
        self._file = data_dir / FOLDER / f"{bench}.json"
        _write_private(self._file, {"bench": bench, "url": self.url, "token": self.token})

    def close(self) -> None:
        """Stop listening here and take the file away; a control process that still runs keeps its own."""
        self.listener.close()
        with contextlib.suppress(OSError):
            self._file.unlink()


def own_origins(url: str | None) -> tuple[str, ...]:
    """Return the origins that the service's own page may have, seen from this machine."""
    if url is None:
        return ()
    port = url.rpartition(":")[2]
    return tuple(f"http://{host}:{port}" for host in ("127.0.0.1", "localhost", "[::1]"))


def _write_private(path: Path, content: dict[str, str]) -> None:
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    path.parent.chmod(0o700)
    new = path.with_suffix(".new")
    with contextlib.suppress(OSError):
        new.unlink()
    # Created with its final rights: at no moment can somebody else open it.
    descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        json.dump(content, file)
    new.rename(path)
