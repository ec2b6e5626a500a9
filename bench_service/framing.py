"""Messages between the service's processes over stream sockets.

A frame is: 4-byte little-endian length of what follows, 4-byte little-endian length of the header, the header
(one UTF-8 JSON object), the body (raw bytes, usually arrays).
"""

import json
import socket
import struct
from typing import Any

MAX_FRAME_BYTES = 256 * 2**20
_LENGTH = struct.Struct("<I")
_RECEIVE_BYTES = 2**18

# A JSON object; which keys it has, its operation says (``op``).
Header = dict[str, Any]
Frame = tuple[Header, bytes]


class FramingError(ValueError):
    """The bytes on a link are no frames, or a frame is too long; the link cannot be used any more."""


def encode(header: Header, body: bytes = b"") -> bytes:
    """Return one frame.

    Parameters
    ----------
    header : dict
        JSON object; numbers must be finite (a missing value is ``None``).
    body : bytes, optional

    Raises
    ------
    FramingError
        The frame would be longer than `MAX_FRAME_BYTES`, or the header is no JSON (NaN, infinity).
    """
    try:
        head = json.dumps(header, allow_nan=False, separators=(",", ":")).encode()
    except (TypeError, ValueError) as error:
        raise FramingError(f"header of operation {header.get('op')!r} is not JSON: {error}") from error
    length = _LENGTH.size + len(head) + len(body)
    if length > MAX_FRAME_BYTES:
        raise FramingError(f"frame of {length} bytes is over the limit of {MAX_FRAME_BYTES} bytes")
    return b"".join((_LENGTH.pack(length), _LENGTH.pack(len(head)), head, body))


class Decoder:
    """Puts frames together from pieces of a byte stream."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    @property
    def pending(self) -> int:
        """Number of bytes held of a frame that is not complete yet."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[Frame]:
        """Take received bytes and return the frames completed by them, oldest first.

        Raises
        ------
        FramingError
            The bytes are no frames.
        """
        self._buffer += data
        frames: list[Frame] = []
        start = 0
        while (end := self._frame_end(start)) is not None:
            frames.append(_parse(bytes(self._buffer[start + _LENGTH.size : end])))
            start = end
        if start:
            del self._buffer[:start]
        return frames

    def _frame_end(self, start: int) -> int | None:
        if len(self._buffer) - start < _LENGTH.size:
            return None
        length = _checked_length(self._buffer, start)
        end = start + _LENGTH.size + length
        return end if end <= len(self._buffer) else None


def send_frame(sock: socket.socket, header: Header, body: bytes = b"") -> None:
    """Send one frame on a blocking socket."""
    sock.sendall(encode(header, body))


def recv_frame(sock: socket.socket) -> Frame | None:
    """Receive one frame from a blocking socket.

    Returns
    -------
    (header, body), or None at the end of the stream.

    Raises
    ------
    FramingError
        The bytes are no frames, or the stream ends inside a frame.
    TimeoutError
        The socket has a time-out and it passed; the stream is then out of step and must be closed.
    """
    prefix = _recv_exactly(sock, _LENGTH.size, at_start=True)
    if prefix is None:
        return None
    content = _recv_exactly(sock, _checked_length(prefix, 0), at_start=False)
    return _parse(content or b"")


def _checked_length(data: bytes | bytearray, start: int) -> int:
    (length,) = _LENGTH.unpack_from(data, start)
    if not _LENGTH.size <= length <= MAX_FRAME_BYTES:
        raise FramingError(f"frame length {length} is outside {_LENGTH.size} to {MAX_FRAME_BYTES} bytes")
    return length


def _parse(content: bytes) -> Frame:
    (head_length,) = _LENGTH.unpack_from(content)
    split = _LENGTH.size + head_length
    if split > len(content):
        raise FramingError(f"header of {head_length} bytes does not fit in a frame of {len(content)} bytes")
    try:
        header = json.loads(content[_LENGTH.size : split])
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise FramingError(f"header is not JSON: {error}") from error
    if not isinstance(header, dict):
        raise FramingError(f"header is a JSON {type(header).__name__}, not an object")
    return header, content[split:]


def _recv_exactly(sock: socket.socket, n: int, *, at_start: bool) -> bytes | None:
    parts = bytearray()
    while len(parts) < n:
        piece = sock.recv(min(n - len(parts), _RECEIVE_BYTES))
        if not piece:
            if at_start and not parts:
                return None
            raise FramingError(f"stream ended inside a frame, {n - len(parts)} bytes missing")
        parts += piece
    return bytes(parts)
