"""A folder of its own for the compiled functions of each state of the source.

Numba keeps what it compiled by the file of the function alone: a function that calls one of another file would go on
running the other's former code after an edit there. So the folder's name holds a hash over the text of all files that
compiled functions come from, and any edit in one of them begins a new folder. A file whose constants compiled functions
take in has the word njit in its text too; a test holds the files to that.

Content is hashed, not times: a copy or a checkout may leave old times on new text. That takes 3 ms for the 220 files of
this package, and another 3 for `hashlib`, which numpy loads anyway.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
import time
from collections.abc import Iterator

_VARIABLE = "NUMBA_CACHE_DIR"
_PREFIX = "numba-"
_MARK = b"njit"
_KEPT_S = 7 * 24 * 3600.0


def keep_apart(package: str) -> None:
    """Name the folder to numba, which must not have been loaded before; never fails.

    Parameters
    ----------
    package : folder of the source; where it cannot be written to, numba's own choice stays

    Notes
    -----
    A user's own choice in the environment stays. A folder of ours there comes from the process that started this one,
    maybe before an edit, and is chosen anew.
    """
    set_before = os.environ.get(_VARIABLE, "")
    if set_before and not _is_ours(set_before):
        return
    os.environ.pop(_VARIABLE, None)
    root = os.path.join(package, "__pycache__")
    folder = os.path.join(root, _PREFIX + stamp(package))
    with contextlib.suppress(OSError):
        os.makedirs(folder, exist_ok=True)
        # The folder's time tells when it was last of use.
        os.utime(folder)
        os.environ[_VARIABLE] = folder
        _remove_former(root, folder)


def stamp(package: str) -> str:
    """Hash over Python's version and over names and text of the files with compiled functions.

    Numba's version stands in its own files, which it does not read where it is another one; to ask for it here would
    take ten times as long as all the rest.
    """
    found = hashlib.blake2b(sys.version.encode(), digest_size=8)
    for path in sorted(source_files(package)):
        with open(path, "rb") as file:
            text = file.read()
        if _MARK in text:
            found.update(f"\0{os.path.relpath(path, package)}\0{len(text)}\0".encode())
            found.update(text)
    return found.hexdigest()


def source_files(package: str) -> Iterator[str]:
    """Paths of all Python files below a folder."""
    with os.scandir(package) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                if entry.name != "__pycache__":
                    yield from source_files(entry.path)
            elif entry.name.endswith(".py"):
                yield entry.path


def _is_ours(folder: str) -> bool:
    root, name = os.path.split(folder)
    return name.startswith(_PREFIX) and os.path.basename(root) == "__pycache__"


def _remove_former(root: str, current: str) -> None:
    """Remove folders that no process has asked for in a week; one that still runs makes its own anew."""
    with os.scandir(root) as entries:
        former = [entry.path for entry in entries if entry.name.startswith(_PREFIX) and entry.path != current]
    old = [path for path in former if os.stat(path).st_mtime < time.time() - _KEPT_S]
    if old:
        import shutil  # 5 ms, and there is seldom anything to remove

        for path in old:
            shutil.rmtree(path, ignore_errors=True)
