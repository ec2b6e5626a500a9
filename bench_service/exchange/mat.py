"""MATLAB's MAT files of version 5: a vector for each column, with this project's names."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench_service.exchange.columns import choose_columns
from bench_service.exchange.errors import RunFileError
from bench_service.exchange.format import Format, RawTable, RunTable

MAGIC = b"MATLAB 5.0 MAT-file"
_START = "started_unix_s"
_LARGEST_BYTES = 4 << 30


def read_vectors(path: Path) -> dict[str, NDArray[np.float64]]:
    """Read every numeric vector of a file, name -> (n,); those of another length than most are left out.

    Raises
    ------
    RunFileError
        Damaged, or no vectors in it.
    """
    # Lazy: scipy.io takes 100 ms.
    from scipy.io import loadmat, whosmat

    try:
        sizes = [int(np.prod(shape)) for _, shape, _ in whosmat(str(path))]
        if 8 * sum(sizes) > _LARGEST_BYTES:
            raise RunFileError(f"{path}: holds {sum(sizes)} numbers; write it as Parquet or CSV")
        found = loadmat(str(path), squeeze_me=True)
    except RunFileError:
        raise
    except Exception as error:  # whatever a damaged file makes of the reader
        raise RunFileError(f"{path}: is not a readable MAT file: {str(error)[:100]}") from error
    vectors = {
        name: np.asarray(value, dtype=np.float64)
        for name, value in found.items()
        if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "fiub"
    }
    lengths = [len(value) for value in vectors.values()]
    if not lengths:
        raise RunFileError(f"{path}: holds no vectors of numbers (a struct? save its fields as variables)")
    usual = max(set(lengths), key=lengths.count)
    return {name: value for name, value in vectors.items() if len(value) == usual}


def _read(path: Path) -> RawTable:
    vectors = read_vectors(path)
    chosen = choose_columns(str(path), vectors)
    return RawTable(tuple(vectors), {own: vectors[name] for own, name in chosen.items()})


def _encode(run: RunTable) -> bytes:
    # Lazy: scipy.io takes 100 ms.
    from scipy.io import savemat

    columns = {name: np.asarray(values).reshape(-1, 1) for name, values in run.columns.items()}
    if run.started_unix_s is not None:
        columns[_START] = np.array([[run.started_unix_s]])
    sink = io.BytesIO()
    savemat(sink, columns)
    return sink.getvalue()


FORMAT = Format(
    name="mat",
    title="MATLAB MAT file with this project's column names",
    suffix=".mat",
    media_type="application/x-matlab-data",
    recognise=lambda head: head.startswith(MAGIC),
    read=_read,
    encode=_encode,
)
