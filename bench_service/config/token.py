"""The token of a service that listens beyond its own machine: who has it may do everything.

One token for all: who may do what, and who did it, is to be told apart where it is checked (`api.access`).
"""

from __future__ import annotations

import ipaddress
import os
import secrets
from collections.abc import Mapping
from pathlib import Path

from bench_service.config.reading import ConfigError

TOKEN_VARIABLE = "BENCH_TOKEN"  # noqa: S105  # the name of a variable
TOKEN_FILE = "token"  # noqa: S105  # in the data directory
_SHORTEST = 16
_BYTES = 24


def is_loopback(host: str) -> bool:
    """Whether an address to listen on can be reached from this machine alone."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def service_token(data_dir: Path, host: str, environ: Mapping[str, str] | None = None) -> str | None:
    """Return the token that requests must carry; None where none is needed.

    ``BENCH_TOKEN`` where it is set, wherever the service listens; else, beyond loopback, the one in the data directory,
    which is made at the first start and stays, so that programs need not be told a new one after each restart.

    Raises
    ------
    ConfigError
        It is too short to be one, or the file cannot be kept from others.
    """
    environ = os.environ if environ is None else environ
    if TOKEN_VARIABLE in environ:
        return _checked(environ[TOKEN_VARIABLE], "environment", TOKEN_VARIABLE)
    if is_loopback(host):
        return None
    path = data_dir / TOKEN_FILE
    if (known := read_token(data_dir)) is not None:
        return _checked(known, str(path), "")
    token = secrets.token_urlsafe(_BYTES)
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            os.fchmod(file.fileno(), 0o600)
            file.write(token + "\n")
    except OSError as error:
        reason = f"cannot be written, and without a token the service does not listen on {host}: {error.strerror}"
        raise ConfigError(str(path), "", reason) from error
    return token


def read_token(data_dir: Path) -> str | None:
    """Return the token of the service of a data directory, for its owner's own programs; None where there is none."""
    if TOKEN_VARIABLE in os.environ:
        return os.environ[TOKEN_VARIABLE]
    try:
        return (data_dir / TOKEN_FILE).read_text(encoding="utf-8").strip() or None
    except (OSError, UnicodeDecodeError):
        return None


def _checked(token: str, file: str, key: str) -> str:
    token = token.strip()
    if len(token) < _SHORTEST or not token.isascii() or not token.isprintable() or " " in token:
        raise ConfigError(file, key, f"is no token: {_SHORTEST} or more printable ASCII characters without spaces")
    return token
