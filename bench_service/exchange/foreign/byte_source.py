"""A text file as a stream of UTF-8, whatever it is wrapped and encoded in; a bomb ends it early."""

from __future__ import annotations

import codecs
import gzip
import io
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, cast

from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.signatures import GZIP

HEAD_BYTES = 512 * 1024
_BLOCK_BYTES = 1 << 20
# A table of numbers packs 3 to 30 times, a long rest 200; gzip ends at about 1030. A small file packs as it likes.
_MOST_TIMES, _NEVER_A_BOMB_BYTES, _MOST_BYTES = 400, 64 << 20, 64 << 30
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
_SPACES = re.compile(rb"[ \t]+")

Progress = Callable[[float], None]


class TextBytes(io.RawIOBase):
    """What is read here is UTF-8 without its mark, from the first row of the table on.

    Parameters
    ----------
    path : the file, gzipped or not
    encoding : as `encoding_of` says
    skip_chars : characters before the table
    one_tab : make one tab of each run of blanks (tables separated by blanks)
    progress : called with the share of the file that was read, 0..1

    Raises
    ------
    RunFileError
        While reading: a damaged or cut gzip file, or one that unpacks to far more than any table would.
    """

    def __init__(
        self, path: Path, encoding: str, skip_chars: int = 0, one_tab: bool = False, progress: Progress | None = None
    ) -> None:
        super().__init__()
        self._path, self._skip_chars, self._one_tab, self._progress = path, skip_chars, one_tab, progress
        self._size = max(path.stat().st_size, 1)
        self._file = path.open("rb")
        self._bytes, self._unpacked = _unwrapped(self._file), 0
        self._decode = codecs.getincrementaldecoder(encoding)("replace").decode
        self._rest, self._line, self._ended = b"", b"", False
        self.n_quotes = 0  # quotation marks that went by

    def readable(self) -> bool:
        """Say that it can be read."""
        return True

    def readinto(self, buffer: object) -> int:
        """Fill `buffer`; returns 0 at the end."""
        view = memoryview(cast(bytearray, buffer))
        while not self._rest and not self._ended:
            self._rest = self._more()
        n = min(len(view), len(self._rest))
        view[:n] = self._rest[:n]
        self._rest = self._rest[n:]
        return n

    def close(self) -> None:
        """Close the file below."""
        self._bytes.close()
        self._file.close()
        super().close()

    def _more(self) -> bytes:
        block = read_block(self._path, self._bytes, _BLOCK_BYTES)
        self._unpacked += len(block)
        check_growth(self._path, self._unpacked, self._size)
        self._ended = not block
        text = self._decode(block, final=self._ended)
        if self._skip_chars:
            self._skip_chars, text = max(0, self._skip_chars - len(text)), text[self._skip_chars :]
        if self._progress is not None:
            self._progress(min(1.0, self._file.tell() / self._size))
        content = text.encode("utf-8", "replace")
        self.n_quotes += content.count(b'"')
        return self._tabbed(content) if self._one_tab else content

    def _tabbed(self, content: bytes) -> bytes:
        whole, newline, self._line = (self._line + content).rpartition(b"\n")
        if self._ended:
            whole, newline, self._line = whole + newline + self._line, b"", b""
        lines = (_SPACES.sub(b"\t", line.strip()) for line in whole.split(b"\n"))
        return b"\n".join(lines) + newline


def read_head(path: Path) -> tuple[str, str, bool]:
    """Read the beginning of a file.

    Returns
    -------
    tuple
        Text of the first half megabyte, its encoding, and whether that is the whole file.

    Raises
    ------
    RunFileError
        Not text, or a damaged gzip file.
    """
    with path.open("rb") as file, _unwrapped(file) as stream:
        head = b""
        while len(head) < HEAD_BYTES and (block := read_block(path, stream, HEAD_BYTES - len(head))):
            head += block
        whole = len(head) < HEAD_BYTES
    encoding = encoding_of(head)
    text = codecs.getincrementaldecoder(encoding)("replace").decode(head, final=whole)
    odd = sum(text.count(chr(code)) for code in (*range(9), *range(14, 27), *range(28, 32)))
    if odd > 0.01 * max(len(text), 1) or "\x00" in text:
        raise RunFileError(f"{path}: is neither a table in text nor a format that is known here (binary content)")
    if not text.strip():
        raise RunFileError(f"{path}: is empty; a table with a line of column names is needed")
    return text, encoding, whole


def encoding_of(head: bytes) -> str:
    """Name the codec of a text by its mark, by its zeros (UTF-16 of Western text), or by what its bytes can be."""
    for mark, codec in _MARKS:
        if head.startswith(mark):
            return codec
    few = head[:2000]
    if len(few) > 3:
        odd, even = few[1::2].count(0) / (len(few) / 2), few[::2].count(0) / (len(few) / 2)
        if odd > 0.5 and even < 0.1:
            return "utf-16-le"
        if even > 0.5 and odd < 0.1:
            return "utf-16-be"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        # Five bytes have no meaning in cp1252; a text that holds one of them is Latin-1 if anything.
        return "latin-1" if any(code in head for code in (0x81, 0x8D, 0x8F, 0x90, 0x9D)) else "cp1252"
    return "utf-8"


def read_block(path: Path, stream: BinaryIO, n_bytes: int) -> bytes:
    """Read at most so many bytes; a damaged wrapping becomes one clear line."""
    try:
        return stream.read(n_bytes)
    except EOFError as error:
        raise RunFileError(f"{path}: the gzip file is cut off; transfer it again") from error
    except (OSError, zlib.error) as error:
        raise RunFileError(f"{path}: cannot be read: damaged gzip file or disk: {error}") from error


def check_growth(path: Path, unpacked: int, packed: int) -> None:
    """Refuse what unpacks to far more than a table of numbers would."""
    if unpacked > _NEVER_A_BOMB_BYTES and unpacked > _MOST_TIMES * packed or unpacked > _MOST_BYTES:
        raise RunFileError(
            f"{path}: unpacks to more than {unpacked / 1e6:.0f} MB from {packed / 1e6:.3g} MB, over {_MOST_TIMES} "
            "times: no table of samples does; nothing was stored"
        )


def _unwrapped(file: BinaryIO) -> BinaryIO:
    packed = file.read(2) == GZIP
    file.seek(0)
    return cast(BinaryIO, gzip.GzipFile(fileobj=file, mode="rb")) if packed else file
