"""Files that a program of the user's own reads: it gets the path and prints the table, in a process of its own.

So a reader under another licence, or one that is not written in Python, stays a program beside this one. Which program
reads which kind of file stands in the configuration, and comes from nowhere else.
"""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from bench_service.exchange.errors import RunFileError

# End of a file's name -> command, to which the path of the file is added.
Readers = Mapping[str, Sequence[str]]
_SAID_LETTERS = 300
# What a program of a person needs; tokens of this service are not among it.
_ENVIRONMENT = ("PATH", "HOME", "LANG", "LC_ALL", "TMPDIR")


@dataclass(frozen=True, slots=True)
class Bounds:
    """How long a reader may take, and how much memory and output it may have."""

    timeout_s: float = 600.0
    memory_bytes: int = 8 << 30
    output_bytes: int = 8 << 30


@contextmanager
def readable(path: Path, title: str, readers: Readers, bounds: Bounds = Bounds()) -> Iterator[Path]:  # noqa: B008
    """Give the file itself, or, where a reader is named for it, what that one prints: CSV or Parquet.

    Parameters
    ----------
    path, title : the file, and its name, whose end tells the reader
    readers : see `Readers`
    bounds : beyond which a reader is ended

    Raises
    ------
    RunFileError
        The reader is not there, fails, takes too long, or prints nothing; and what is raised inside, told of `path`.
    """
    command = readers.get(Path(title).suffix.lower())
    if command is None:
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="reader-") as folder:
        printed = Path(folder, f"{Path(title).stem or 'run'}.csv")
        _print_table([*command, str(path)], path, printed, bounds)
        try:
            yield printed
        except RunFileError as error:
            told = f"{path}, as {command[0]!r} prints it"
            error.args = (str(error).replace(str(printed), told), *error.args[1:])
            raise


def _print_table(command: list[str], path: Path, printed: Path, bounds: Bounds) -> None:
    said = printed.with_suffix(".said")
    with printed.open("wb") as output, said.open("wb") as errors:
        try:
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=output, stderr=errors, start_new_session=True,
                env={name: os.environ[name] for name in _ENVIRONMENT if name in os.environ},
            )  # fmt: skip
        except OSError as error:
            reason = error.strerror or str(error)
            raise RunFileError(
                f"{path}: its reader {command[0]!r} cannot be started ({reason}): install it, or correct [readers]"
            ) from error
        status = _waited(process, bounds)
    if status is None:
        raise RunFileError(f"{path}: its reader {command[0]!r} took longer than {bounds.timeout_s:g} s and was ended")
    if status != 0:
        raise RunFileError(f"{path}: its reader {command[0]!r} {_failure(status, said)}")
    if printed.stat().st_size == 0:
        raise RunFileError(f"{path}: its reader {command[0]!r} prints nothing; it must print a table with a header")


def _waited(process: subprocess.Popen[bytes], bounds: Bounds) -> int | None:
    """Return the exit status; None where it took too long. Nothing of it goes on."""
    try:
        resource.prlimit(process.pid, resource.RLIMIT_AS, (bounds.memory_bytes, bounds.memory_bytes))
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (bounds.output_bytes, bounds.output_bytes))
    except ProcessLookupError:  # it has ended already
        pass
    try:
        return process.wait(bounds.timeout_s)
    except BaseException as error:
        os.killpg(process.pid, signal.SIGKILL)  # it is the first of a group of its own, and has not been waited for
        process.wait()
        if isinstance(error, subprocess.TimeoutExpired):
            return None
        raise


def _failure(status: int, said: Path) -> str:
    with said.open("rb") as stream:
        stream.seek(max(0, said.stat().st_size - 4096))
        lines = stream.read().decode(errors="replace").split("\n")
    last = next((line.strip() for line in reversed(lines) if line.strip()), "")
    text = "".join(letter for letter in last if letter.isprintable())[:_SAID_LETTERS]
    how = f"was ended by signal {-status}" if status < 0 else f"fails with exit status {status}"
    return f"{how}: {text}" if text else f"{how} and says nothing"
