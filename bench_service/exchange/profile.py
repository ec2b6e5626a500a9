"""Current profiles: CSV with `time_s,current_A`; a value holds to the next time, the last row ends the profile."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench_service.exchange.delimited import read_columns
from bench_service.exchange.errors import ProfileFileError

_NEEDED = ("time_s", "current_A")


@dataclass(frozen=True, slots=True)
class ProfileFile:
    """A profile as read.

    Attributes
    ----------
    name : file name without its ends
    time_s : (n,) strictly increasing from 0, in s
    current_A : (n,) in A, positive charges; value k holds from time k to time k + 1
    """

    name: str
    time_s: NDArray[np.float64]
    current_A: NDArray[np.float64]


def read_profile(path: Path) -> ProfileFile:
    """Read a profile (CSV or gzipped CSV).

    Raises
    ------
    ProfileFileError
        Missing file, wrong columns, fewer than two rows, a value that is missing, infinite or no number,
        a first time other than 0, time that does not increase.
    """
    if not path.is_file():
        raise ProfileFileError(f"{path}: {'is a directory' if path.is_dir() else 'no such file'}")
    _, columns = read_columns(path, lambda names: _choose(path, names), ProfileFileError)
    time_s, current_A = columns["time_s"], columns["current_A"]
    if len(time_s) < 2:
        raise ProfileFileError(f"{path}: {len(time_s)} row(s); a profile needs at least 2 (the last row only ends it)")
    for name, values in (("time_s", time_s), ("current_A", current_A)):
        bad = ~np.isfinite(values)
        if bad.any():
            k = int(np.argmax(bad))
            what = "is missing (empty or NaN)" if np.isnan(values[k]) else "is infinite"
            raise ProfileFileError(f"{path}: row {k + 2}: {name} {what}; every row needs a finite number")
    if time_s[0] != 0.0:
        raise ProfileFileError(f"{path}: row 2: time_s is {time_s[0]:g} s; a profile starts at 0 s")
    falls = np.diff(time_s) <= 0
    if falls.any():
        k = int(np.argmax(falls)) + 1
        raise ProfileFileError(
            f"{path}: row {k + 2}: time_s is {time_s[k]:g} s after {time_s[k - 1]:g} s; time must increase"
        )
    return ProfileFile(path.name.split(".")[0], time_s, current_A)


def _choose(path: Path, names: list[str]) -> dict[str, str]:
    missing = [name for name in _NEEDED if name not in names]
    if missing:
        there = ", ".join(map(repr, names[:12]))
        raise ProfileFileError(f"{path}: wrong columns: a profile needs {', '.join(_NEEDED)}; the file has {there}")
    return {name: name for name in _NEEDED}
