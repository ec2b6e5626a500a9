"""Blocks: some rows of a stream as compressed bytes with a checksum. Pure.

Codec ``shuffle-zlib/1``: a 2-byte length and the layout as text (``time_s:f8,current_A:f8,...``), then each column
with its bytes transposed (all first bytes, all second bytes, ...; neighbouring samples share their high bytes, so
that runs of equal bytes arise), all of it compressed by zlib at level 1. A block says what its columns are, so that
old blocks stay readable when a stream gains a column.
"""

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench_service.streams import Column, Columns, Layout, row_bytes

CODEC = "shuffle-zlib/1"
_LEVEL = 1
_PREFIX = struct.Struct("<H")
_PLACE = struct.Struct("<qq")


class BlockError(ValueError):
    """A block cannot be decoded: its checksum is wrong, or its codec is unknown."""


@dataclass(frozen=True, slots=True)
class Block:
    """Rows ``seq0`` to ``seq0 + n - 1`` of one stream of one run, encoded.

    Attributes
    ----------
    seq0 : int
        Sequence number of the first row.
    n : int
        Number of rows.
    codec : str
        Name and version of the encoding.
    crc : int
        CRC-32 over `seq0`, `n` and `data`.
    data : bytes
    """

    seq0: int
    n: int
    codec: str
    crc: int
    data: bytes


def encode(seq0: int, layout: Layout, columns: Mapping[str, NDArray[Any]]) -> Block:
    """Return the columns, each of shape (n,), as a block.

    Raises
    ------
    ValueError
        Columns differ in length.
    """
    arrays = [np.ascontiguousarray(columns[column.name], column.numpy) for column in layout]
    n = len(arrays[0])
    if any(array.shape != (n,) for array in arrays):
        raise ValueError(f"columns differ in shape: {[array.shape for array in arrays]}")
    described = ",".join(f"{column.name}:{column.dtype}" for column in layout).encode()
    parts = [_PREFIX.pack(len(described)), described, *(_shuffled(array) for array in arrays)]
    data = zlib.compress(b"".join(parts), _LEVEL)
    return Block(seq0, n, CODEC, _checksum(seq0, n, data), data)


def decode(block: Block) -> tuple[Layout, Columns]:
    """Return layout and columns, each of shape (n,), of a block.

    Raises
    ------
    BlockError
        The checksum is wrong, the codec unknown, or the content not what the block says.
    """
    layout, content, offset = _unpacked(block)
    columns = {column.name: np.empty(block.n, column.numpy) for column in layout}
    _unshuffle(layout, content, offset, columns)
    return layout, columns


def decode_into(block: Block, layout: Layout, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write a block's rows into arrays that are there; other threads may do so in other rows meanwhile.

    Parameters
    ----------
    block : Block
    layout : Layout
        That the block must have.
    columns : mapping of str to array, shape (n,)

    Raises
    ------
    BlockError
        As `decode`, and where the block has other columns.
    """
    found, content, offset = _unpacked(block)
    if found != layout:
        raise BlockError("it has other columns than those before")
    _unshuffle(layout, content, offset, columns)


def _unpacked(block: Block) -> tuple[Layout, bytes, int]:
    """Return layout and content of a block, and where its columns begin."""
    if block.codec != CODEC:
        raise BlockError(f"unknown codec {block.codec!r}; this version reads {CODEC!r}")
    if _checksum(block.seq0, block.n, block.data) != block.crc:
        raise BlockError("wrong checksum")
    try:
        content = zlib.decompress(block.data)
        (described,) = _PREFIX.unpack_from(content)
        offset = _PREFIX.size + described
        layout = _layout(content[_PREFIX.size : offset].decode())
    except (zlib.error, struct.error, ValueError) as error:
        raise BlockError(f"unreadable content: {error}") from error
    if len(content) - offset != block.n * row_bytes(layout):
        raise BlockError(f"{len(content) - offset} bytes are not {block.n} rows of {row_bytes(layout)} bytes")
    return layout, content, offset


def _layout(text: str) -> Layout:
    return tuple(Column(*item.rsplit(":", 1)) for item in text.split(","))


def _checksum(seq0: int, n: int, data: bytes) -> int:
    return zlib.crc32(data, zlib.crc32(_PLACE.pack(seq0, n)))


def _shuffled(array: NDArray[Any]) -> bytes:
    return array.view(np.uint8).reshape(len(array), array.itemsize).T.tobytes()


def _unshuffle(layout: Layout, content: bytes, offset: int, columns: Mapping[str, NDArray[Any]]) -> None:
    for column in layout:
        values = columns[column.name]
        size, n = column.numpy.itemsize, len(values)
        planes = np.frombuffer(content, np.uint8, n * size, offset).reshape(size, n)
        target = values.view(np.uint8).reshape(n, size)
        for k in range(size):
            target[:, k] = planes[k]
        offset += n * size
