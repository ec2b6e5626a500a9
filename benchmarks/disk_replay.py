"""What a disk holds after a power cut, from a trace of the system calls that wrote to it (strace -f -y -xx).

Two kinds of disk. ``synced``: only what was synced survives, names of files too (their directory must be synced).
``torn``: of what was written since the last sync each page of 4 KiB survives or not by a coin, and so does each name.
"""

from __future__ import annotations

import random
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

SYSCALLS = "openat,write,pwrite64,ftruncate,rename,renameat,renameat2,unlink,unlinkat,fsync,fdatasync"
PAGE = 4096
_LINE = re.compile(r"^(?P<pid>\d+) +(?P<rest>.*)$")
_DONE = re.compile(r"^(?P<name>\w+)\((?P<args>.*)\) += (?P<ret>-?\d+|\?)")
_UNFINISHED = re.compile(r"^(?P<head>\w+\(.*?) *<unfinished \.\.\.>$")
_RESUMED = re.compile(r"^<\.\.\. \w+ resumed>(?P<tail>.*)$")
_FD = re.compile(r"^-?\w+<(?P<path>[^>]*)>")
_HEX = re.compile(r"\\x([0-9a-f]{2})")


@dataclass(frozen=True, slots=True)
class Operation:
    """One call that has come back without an error."""

    name: str
    path: str
    offset: int = 0
    data: bytes = b""
    to: str = ""


def operations(trace: Path) -> Iterator[Operation]:
    """Give the calls of a trace in the order in which they came back."""
    begun: dict[str, str] = {}
    positions: dict[tuple[str, str], int] = {}
    for line in trace.read_text(encoding="latin-1").splitlines():
        matched = _LINE.match(line)
        if matched is None:
            continue
        pid, rest = matched["pid"], matched["rest"]
        if waiting := _UNFINISHED.match(rest):
            begun[pid] = waiting["head"]
            continue
        if resumed := _RESUMED.match(rest):
            rest = begun.pop(pid, "") + resumed["tail"]
        call = _DONE.match(rest)
        if call is None or call["ret"] == "?" or int(call["ret"]) < 0:
            continue
        yield from _operation(call["name"], call["args"], rest, positions)


def _operation(name: str, text: str, whole: str, positions: dict[tuple[str, str], int]) -> Iterator[Operation]:
    arguments = text.split(", ")
    strings = [_bytes(part) for part in re.findall(r'"((?:\\x[0-9a-f]{2})*)"', text)]
    fd = _FD.match(arguments[0])
    path = _bytes(fd["path"]).decode() if fd else ""
    if name == "openat":
        opened = _FD.match(whole.rpartition("= ")[2])
        if opened and "O_CREAT" in text:
            path = _bytes(opened["path"]).decode()
            yield Operation("create", path)
            if "O_TRUNC" in text:
                positions[path, "at"] = 0
                yield Operation("truncate", path)
    elif name == "write" and strings:
        at = positions.get((path, "at"), 0)
        positions[path, "at"] = at + len(strings[0])
        yield Operation("write", path, at, strings[0])
    elif name == "pwrite64":
        yield Operation("write", path, int(arguments[-1]), strings[0])
    elif name == "ftruncate":
        yield Operation("truncate", path, int(arguments[-1]))
    elif name in ("fsync", "fdatasync"):
        yield Operation("sync", path)
    elif name.startswith("rename"):
        yield Operation("rename", strings[0].decode(), to=strings[1].decode())
    elif name.startswith("unlink"):
        yield Operation("unlink", strings[0].decode())


def _bytes(text: str) -> bytes:
    return bytes.fromhex("".join(_HEX.findall(text)))


@dataclass(slots=True)
class _File:
    durable: bytearray = field(default_factory=bytearray)
    pending: list[Operation] = field(default_factory=list)


class Disk:
    """Files below a folder, with what of them is on the disk and what is not yet.

    Parameters
    ----------
    root : Path
        Only what lies below it is kept.
    """

    def __init__(self, root: Path) -> None:
        self._root = f"{root}/"
        self._names: dict[str, _File] = {}
        self._durable_names: dict[str, _File] = {}

    def apply(self, operation: Operation) -> None:
        """Do a call."""
        path = operation.path
        if not f"{path}/".startswith(self._root):
            return
        if operation.name == "create":
            self._names.setdefault(path, _File())
        elif operation.name in ("write", "truncate") and path in self._names:
            self._names[path].pending.append(operation)
        elif operation.name == "sync":
            if path in self._names:
                file = self._names[path]
                for pending in file.pending:
                    _put(file.durable, pending)
                file.pending.clear()
            else:
                self._sync_names(path)
        elif operation.name == "rename" and path in self._names:
            self._names[operation.to] = self._names.pop(path)
        elif operation.name == "unlink":
            self._names.pop(path, None)

    def _sync_names(self, folder: str) -> None:
        def inside(name: str) -> bool:
            return name.rpartition("/")[0] == folder.rstrip("/")

        kept = {name: file for name, file in self._durable_names.items() if not inside(name)}
        self._durable_names = kept | {name: file for name, file in self._names.items() if inside(name)}

    def after_cut(self, into: Path, torn: random.Random | None) -> None:
        """Write what is left after a power cut now into a folder; with a coin for what was not synced."""
        into.mkdir(parents=True)
        for name in sorted(self._names.keys() | self._durable_names.keys()):
            was, now = self._durable_names.get(name), self._names.get(name)
            file = was if torn is None or torn.random() < 0.5 else now
            if file is None or name.endswith("-shm"):  # shared memory of processes that are gone
                continue
            content = bytearray(file.durable)
            if torn is not None:
                for piece in (piece for pending in file.pending for piece in _pages(pending)):
                    if torn.random() < 0.5:
                        _put(content, piece)
            target = into / name.removeprefix(self._root)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)


def _put(content: bytearray, operation: Operation) -> None:
    if operation.name == "truncate":
        size = operation.offset
        content[size:] = bytes(max(0, size - len(content)))
        return
    end = operation.offset + len(operation.data)
    if len(content) < end:
        content.extend(bytes(end - len(content)))
    content[operation.offset : end] = operation.data


def _pages(operation: Operation) -> Iterator[Operation]:
    if operation.name == "truncate":
        yield operation
        return
    at, data = operation.offset, operation.data
    while data:
        size = PAGE - at % PAGE
        yield Operation("write", operation.path, at, data[:size])
        at, data = at + size, data[size:]
