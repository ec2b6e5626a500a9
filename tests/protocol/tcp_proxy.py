"""A proxy for Modbus TCP that notes each request and lets a test change or hold back each reply."""

from __future__ import annotations

import asyncio
import contextlib
import struct
from collections.abc import Callable

SAMPLE = struct.pack(">BHH", 3, 200, 12)  # how the driver reads a sample of the generic map
DROP, CLOSE = "drop", "close"
Change = Callable[[bytes], "bytes | str"]


class Proxy:
    """Passes Modbus TCP on.

    `on_reply(request, reply)` gets and returns PDUs, or returns `DROP` or `CLOSE`; dropped frames are kept in
    `held`, from where `late` sends them.
    """

    def __init__(self, port: int) -> None:
        self._target = port
        self.requests: list[bytes] = []
        self.on_reply: Callable[[bytes, bytes], bytes | str] | None = None
        self.held: list[tuple[asyncio.StreamWriter, bytes]] = []
        self._writers: list[asyncio.StreamWriter] = []

    async def start(self) -> int:
        """Listen; return the port."""
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        return self._server.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        """Close every connection."""
        self._server.close()
        for writer in self._writers:
            writer.close()
        await self._server.wait_closed()

    async def late(self) -> bool:
        """Send what was held back, on the connection it belongs to; False if that is closed."""
        sent = True
        for writer, frame in self.held:
            sent = sent and not writer.is_closing()
            with contextlib.suppress(ConnectionError):
                writer.write(frame)
                await writer.drain()
        return sent

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        up_reader, up_writer = await asyncio.open_connection("127.0.0.1", self._target)
        self._writers.append(up_writer)
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError):
            while not writer.is_closing():
                header, request = await self._frame(reader)
                self.requests.append(request)
                up_writer.write(header + request)
                header, reply = await self._frame(up_reader)
                changed = self.on_reply(request, reply) if self.on_reply else reply
                if changed == CLOSE:
                    break
                if isinstance(changed, str):
                    self.held.append((writer, header + reply))
                    continue
                writer.write(header[:4] + struct.pack(">H", len(changed) + 1) + header[6:] + changed)
        up_writer.close()
        writer.close()

    @staticmethod
    async def _frame(reader: asyncio.StreamReader) -> tuple[bytes, bytes]:
        header = await reader.readexactly(7)
        return header, await reader.readexactly(int.from_bytes(header[4:6], "big") - 1)


def only(wanted: bytes, change: Change) -> Callable[[bytes, bytes], bytes | str]:
    """Change the replies to requests that start with some bytes."""
    return lambda request, reply: change(reply) if request.startswith(wanted) else reply


def patched(address: int, *words: int) -> Callable[[bytes], bytes]:
    """Put other registers into the reply to a sample."""
    at = 2 + 2 * (address - 200)
    data = struct.pack(f">{len(words)}H", *words)
    return lambda reply: reply[:at] + data + reply[at + len(data) :]
