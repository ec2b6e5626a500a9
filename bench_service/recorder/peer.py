"""One end of a link, without blocking: frames in, frames out."""

import socket

from bench_service.framing import Decoder, Frame, Header, encode

_RECEIVE_BYTES = 2**18
_MAX_OUTGOING_BYTES = 2**20
_MAX_DESCRIPTORS = 8
_LAST_WORDS_S = 1.0


class Peer:
    """A link to another process.

    A peer that does not read must not hold up the recorder: what it does not take is kept up to 1 MiB, and dropped
    from there on (acknowledgements are cumulative, so that a later one makes up for those lost).
    """

    def __init__(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        self.sock = sock
        self.descriptors: list[int] = []
        self._decoder = Decoder()
        self._outgoing = bytearray()

    @property
    def wants_to_send(self) -> bool:
        """Whether frames wait for the socket to take them."""
        return bool(self._outgoing)

    def receive(self) -> list[Frame] | None:
        """Return the frames that have come in, or None at the end of the link.

        File descriptors that came along are added to `descriptors`.

        Raises
        ------
        FramingError
            The bytes are no frames.
        """
        try:
            data, descriptors, _flags, _address = socket.recv_fds(
                self.sock, _RECEIVE_BYTES, _MAX_DESCRIPTORS, socket.MSG_CMSG_CLOEXEC
            )
        except BlockingIOError:
            return []
        except OSError:
            return None
        self.descriptors += descriptors
        return self._decoder.feed(data) if data else None

    def send(self, header: Header) -> None:
        """Send a frame now or, where the socket is full, with a later `flush`."""
        if len(self._outgoing) < _MAX_OUTGOING_BYTES:
            self._outgoing += encode(header)
        self.flush()

    def flush(self) -> None:
        """Send what waits, as far as the socket takes it; a closed link shows when it is read."""
        try:
            while self._outgoing:
                del self._outgoing[: self.sock.send(self._outgoing)]
        except BlockingIOError:
            return
        except OSError:
            self._outgoing.clear()

    def close(self, last: Header | None = None) -> None:
        """Close the link, after a last frame if there is one and the other side takes it within a second."""
        if last is not None:
            self.sock.settimeout(_LAST_WORDS_S)
            try:
                self.sock.sendall(bytes(self._outgoing) + encode(last))
            except OSError:
                pass
        self.sock.close()
