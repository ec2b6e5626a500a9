"""A framed, non-blocking end of a stream socket inside an asyncio loop."""

import asyncio
import socket
from collections import deque
from collections.abc import Callable

from bench_service.framing import Decoder, FramingError, Header, encode

_RECEIVE_BYTES = 1 << 18


class FrameLink:
    """Sends and receives frames without ever blocking the loop.

    Parameters
    ----------
    sock : socket.socket
        Connected stream socket; owned by the link from now on.
    on_frame : callable
        Gets header and body of each received frame.
    on_closed : callable
        Called once with the reason when the other end is gone; not by `close`.
    """

    def __init__(
        self,
        sock: socket.socket,
        on_frame: Callable[[Header, bytes], None],
        on_closed: Callable[[str], None],
    ) -> None:
        sock.setblocking(False)
        self._sock = sock
        self._on_frame = on_frame
        self._on_closed = on_closed
        self._decoder = Decoder()
        self._out: deque[memoryview] = deque()
        self._drained = asyncio.Event()
        self._drained.set()
        self._loop = asyncio.get_running_loop()
        self._open = True
        self._loop.add_reader(sock, self._readable)

    @property
    def is_open(self) -> bool:
        """Whether the other end may still be there."""
        return self._open

    @property
    def idle(self) -> bool:
        """Whether everything sent so far is with the operating system."""
        return not self._out

    def send(self, header: Header, body: bytes = b"") -> None:
        """Send a frame, or queue it while the other end does not read; dropped once the link is closed."""
        if not self._open:
            return
        data = memoryview(encode(header, body))
        if not self._out:
            data = self._try_send(data)
            if not data or not self._open:
                return
            self._loop.add_writer(self._sock, self._writable)
            self._drained.clear()
        self._out.append(data)

    def look(self) -> None:
        """Take what the other end has sent before now, without waiting for the loop's turn."""
        if self._open:
            self._readable()

    async def drain(self, timeout_s: float) -> bool:
        """Wait until everything is sent or the link is closed; return whether that came in time."""
        try:
            await asyncio.wait_for(self._drained.wait(), timeout_s)
        except TimeoutError:
            return False
        return True

    def close(self) -> None:
        """Close this end; frames not yet sent are lost."""
        if self._open:
            self._open = False
            self._loop.remove_reader(self._sock)
            self._loop.remove_writer(self._sock)
            self._out.clear()
            self._drained.set()
        self._sock.close()

    def _try_send(self, data: memoryview) -> memoryview:
        try:
            return data[self._sock.send(data) :]
        except (BlockingIOError, InterruptedError):
            return data
        except OSError as error:
            self._lost(f"sending failed: {error.strerror}")
            return data

    def _writable(self) -> None:
        while self._out:
            rest = self._try_send(self._out[0])
            if not self._open:
                return
            if rest:
                self._out[0] = rest
                return
            self._out.popleft()
        self._loop.remove_writer(self._sock)
        self._drained.set()

    def _readable(self) -> None:
        try:
            data = self._sock.recv(_RECEIVE_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._lost(f"receiving failed: {error.strerror}")
            return
        if not data:
            self._lost("closed by the other end")
            return
        try:
            frames = self._decoder.feed(data)
        except FramingError as error:
            self._lost(str(error))
            return
        for header, body in frames:
            self._on_frame(header, body)

    def _lost(self, reason: str) -> None:
        # A failed send must not lose what the other end said before it died.
        if self._open:
            self._read_the_rest()
        if self._open:
            self.close()
            self._on_closed(reason)

    def _read_the_rest(self) -> None:
        while True:
            try:
                data = self._sock.recv(_RECEIVE_BYTES)
                if not data:
                    return
                for header, body in self._decoder.feed(data):
                    self._on_frame(header, body)
            except (OSError, FramingError):
                return
