"""Content hash of a run of any length: block by block, in bounded memory.

The hash goes by columns (`streams.content_hash`), the blocks by rows: so each column is kept aside until the last
block, in memory while it is short, then in a file without a name beside the samples.
"""

from __future__ import annotations

import hashlib
from contextlib import ExitStack
from pathlib import Path
from tempfile import SpooledTemporaryFile
from typing import IO

import numpy as np
from sqlalchemy import Connection

from bench_service.store.blocks import BlockError, decode
from bench_service.store.intact import block_of, check_times
from bench_service.store.samples import chunks_of, read_stream
from bench_service.streams import NOT_HASHED, SAMPLES, STREAMS, Layout, content_hash

_KEPT_BYTES = 4 * 2**20  # of each column, in memory
_PIECE_BYTES = 2**20


def stored_hash(link: Connection, run_id: str, folder: Path) -> str | None:
    """Return the content hash of a run's samples over an open connection; None where a block is damaged.

    Parameters
    ----------
    link : Connection
    run_id : str
    folder : Path
        Where columns of more than some megabytes are kept meanwhile; with no room there, they are kept in memory.
    """
    try:
        with ExitStack() as spools:
            return _hash(link, run_id, folder, spools)
    except OSError:
        data = read_stream(link, run_id, SAMPLES)
        return None if data.damaged else content_hash(data.columns)


def _hash(link: Connection, run_id: str, folder: Path, spools: ExitStack) -> str | None:
    aside: dict[str, IO[bytes]] = {}
    first: Layout = ()
    next_seq = 0
    with chunks_of(link, run_id, SAMPLES) as found:
        for row in found:
            try:
                layout, columns = decode(block_of(row))
                check_times(row, columns)
            except BlockError:
                return None
            if first and layout != first:
                return None
            if not first:
                first = layout
                aside = {column.name: spools.enter_context(_spool(folder)) for column in layout}
            skip = max(next_seq - row.seq0, 0)
            next_seq = max(next_seq, row.seq0 + row.n)
            for column in layout if skip < row.n else ():
                aside[column.name].write(np.ascontiguousarray(columns[column.name][skip:], column.numpy).data)
    digest = hashlib.sha256()
    for column in STREAMS[SAMPLES]:
        if column.name not in NOT_HASHED and column.name in aside:
            aside[column.name].seek(0)
            while piece := aside[column.name].read(_PIECE_BYTES):
                digest.update(piece)
    return digest.hexdigest()


def _spool(folder: Path) -> SpooledTemporaryFile[bytes]:
    return SpooledTemporaryFile(_KEPT_BYTES, dir=str(folder))
