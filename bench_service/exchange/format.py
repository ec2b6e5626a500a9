"""What one exchange format offers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.generic]


@dataclass(frozen=True, slots=True)
class RawTable:
    """Columns as they stand in a file.

    Attributes
    ----------
    names : every column's name, in the file's order
    columns : own name -> (n,) float64, NaN where the file has nothing
    """

    names: tuple[str, ...]
    columns: dict[str, NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class RunTable:
    """One run on its way out.

    Attributes
    ----------
    columns : own name -> (n,); at least time_s, current_A, voltage_V; NaN where missing; positive current charges
    started_unix_s : UTC of the run's time 0 as Unix time in s, or None where unknown
    """

    columns: dict[str, Array]
    started_unix_s: float | None = None


@dataclass(frozen=True, slots=True)
class Format:
    """A file format.

    Attributes
    ----------
    name : what `--format` calls it
    title : for people
    suffix : usual end of a file name
    media_type : for HTTP
    recognise : whether the file's first bytes are of this format, or None where it is not read by content
    read : file -> columns; raises RunFileError
    encode : run -> the bytes of a file, or None where the format is only read
    """

    name: str
    title: str
    suffix: str
    media_type: str
    recognise: Callable[[bytes], bool] | None = None
    read: Callable[[Path], RawTable] | None = None
    encode: Callable[[RunTable], bytes] | None = None
