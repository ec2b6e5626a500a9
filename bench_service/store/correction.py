"""A single wrong bit in a stored block found and turned back. Pure.

A cyclic redundancy check is linear: the difference between the checksum that is stored and the one that the bytes have
depends only on where a bit is wrong, and no two places of a block have the same (Peterson and Brown 1961, "Cyclic codes
for error detection"). What is found is believed only if the block then decodes, whose content has a checksum of its own
(Adler-32, RFC 1950).
"""

import struct
import zlib
from dataclasses import replace

from bench_service.store.blocks import Block, BlockError, decode

_PLACE = struct.Struct("<qq")
_REVERSED_POLYNOMIAL = 0xEDB88320


def corrected(block: Block) -> Block | None:
    """Return a damaged block as it was, where one wrong bit in data, place or checksum explains the damage; or None."""
    message = _PLACE.pack(block.seq0, block.n) + block.data
    difference = zlib.crc32(message) ^ block.crc
    if not 0 < difference < 2**32:
        return None
    if difference.bit_count() == 1 and (sound := _sound(replace(block, crc=block.crc ^ difference))) is not None:
        return sound
    found = _wrong_bit(difference, len(message))
    if found is None:
        return None
    byte, bit = found
    turned = bytearray(message)
    turned[byte] ^= 1 << bit
    seq0, n = _PLACE.unpack_from(turned)
    return _sound(replace(block, seq0=seq0, n=n, data=bytes(turned[_PLACE.size :])))


def _sound(block: Block) -> Block | None:
    try:
        decode(block)
    except (BlockError, MemoryError):
        return None
    return block


def _wrong_bit(difference: int, n_bytes: int) -> tuple[int, int] | None:
    """Step the checksum's register back byte by byte until the difference is that of a single bit."""
    table = _table()
    by_top = {entry >> 24: index for index, entry in enumerate(table)}
    single = {table[1 << bit]: bit for bit in range(8)}
    for behind in range(n_bytes):
        if (bit := single.get(difference)) is not None:
            return n_bytes - 1 - behind, bit
        index = by_top[difference >> 24]
        difference = ((difference ^ table[index]) << 8 & 0xFFFFFFFF) | index
    return None


def _table() -> list[int]:
    """Return the register after each possible byte, from nothing (ITU-T V.42, reversed)."""
    entries = []
    for byte in range(256):
        register = byte
        for _ in range(8):
            register = register >> 1 ^ (_REVERSED_POLYNOMIAL if register & 1 else 0)
        entries.append(register)
    return entries
