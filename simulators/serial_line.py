"""A serial line that is not there: a pseudo-terminal, or a real port, paced to its baud rate in both directions.

A bare pseudo-terminal carries a message in no time, and hides that 100 Hz need 115200 baud.
"""

import asyncio
import contextlib
import ctypes
import os
import stat
import struct
import termios
import time
import tty
from dataclasses import dataclass
from pathlib import Path

__all__ = ["SerialLine", "SerialSettings", "WakeUp"]

_LIBC = ctypes.CDLL(None, use_errno=True)
_CLOCK_MONOTONIC, _ABSOLUTE = 1, 1
CHUNK_BYTES = 14  # a 16550 tells its computer of received bytes in pieces of this size
READ_BYTES = 4096


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialSettings:
    """A line as the device is set up for it.

    Attributes
    ----------
    device : str or None
        A real port, or where a link to the pseudo-terminal is put; None: the pseudo-terminal's own name.
    baud : int
    parity : str
        "N", "E" or "O".
    stopbits : int
    echo : bool
        The client hears its own bytes, as behind many two-wire adapters.
    """

    device: str | None = None
    baud: int = 115200
    parity: str = "N"
    stopbits: int = 1
    echo: bool = False

    @property
    def character_s(self) -> float:
        """Time of one character on the line."""
        return (1 + 8 + (self.parity != "N") + self.stopbits) / self.baud

    def __post_init__(self) -> None:
        """Check the settings once.

        Raises
        ------
        ValueError
            If no line is like that.
        """
        if not 300 <= self.baud <= 4_000_000 or self.parity not in ("N", "E", "O") or self.stopbits not in (1, 2):
            raise ValueError(f"a serial line of {self.baud} baud, parity {self.parity!r}, {self.stopbits} stop bits")


class WakeUp:
    """Waits until a monotonic time to better than 0.1 ms; the event loop's own timer rounds up to milliseconds."""

    def __init__(self) -> None:
        self._fd = _LIBC.timerfd_create(_CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC)
        if self._fd < 0:
            raise OSError(ctypes.get_errno(), "timerfd_create")
        self._loop = asyncio.get_running_loop()

    async def until(self, time_s: float) -> None:
        """Return at a monotonic time, at once if it has passed."""
        if time_s <= time.monotonic():
            return
        setting = struct.pack("qqqq", 0, 0, int(time_s), int(time_s % 1.0 * 1e9))
        if _LIBC.timerfd_settime(self._fd, _ABSOLUTE, setting, None):
            raise OSError(ctypes.get_errno(), "timerfd_settime")
        expired = self._loop.create_future()
        self._loop.add_reader(self._fd, lambda: expired.done() or expired.set_result(None))
        try:
            await expired
        finally:
            self._loop.remove_reader(self._fd)
            with contextlib.suppress(BlockingIOError):
                os.read(self._fd, 8)

    def close(self) -> None:
        """Free the timer."""
        os.close(self._fd)


class SerialLine:
    """The device's end of a serial line.

    Parameters
    ----------
    settings : SerialSettings

    Raises
    ------
    OSError
        If the port cannot be opened, or the link not be made.
    """

    def __init__(self, settings: SerialSettings) -> None:
        self.settings = settings
        self._loop = asyncio.get_running_loop()
        self._link: Path | None = None
        self._client_end = -1
        self._fd = -1
        self.device = self._open(settings.device)
        os.set_blocking(self._fd, False)
        self._wake_up = WakeUp()
        self._received = bytearray()
        self._arrived_s = 0.0  # when the last of the received bytes was through the line
        self._ready = asyncio.Event()
        self._loop.add_reader(self._fd, self._readable)

    @property
    def received(self) -> bytearray:
        """What has come and was not yet taken; the owner takes bytes out of it."""
        return self._received

    @property
    def arrived_s(self) -> float:
        """Monotonic time at which the last received byte was through the line."""
        return self._arrived_s

    async def wait(self, timeout_s: float | None) -> bool:
        """Wait for more bytes; return whether some came in time."""
        self._ready.clear()
        try:
            await asyncio.wait_for(self._ready.wait(), timeout_s)
        except TimeoutError:
            return False
        await self._wake_up.until(self._arrived_s)
        return True

    async def until(self, time_s: float) -> None:
        """Wait until a monotonic time."""
        await self._wake_up.until(time_s)

    async def send(self, data: bytes, start_s: float | None = None) -> None:
        """Send bytes at the pace of the line, from now on or from a time just passed.

        A device that answers at once has its first bit on the line when the request is through; what this computer
        took to make the answer must not be added to that.
        """
        start_s = time.monotonic() if start_s is None else start_s
        for first in range(0, len(data), CHUNK_BYTES):
            chunk = data[first : first + CHUNK_BYTES]
            await self._wake_up.until(start_s + (first + len(chunk)) * self.settings.character_s)
            self._write(chunk)

    def close(self) -> None:
        """Close the line; the link to it goes with it."""
        if self._fd < 0:
            return
        self._loop.remove_reader(self._fd)
        self._wake_up.close()
        os.close(self._fd)
        if self._client_end >= 0:
            os.close(self._client_end)
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        self._fd = -1

    def _open(self, device: str | None) -> str:
        path = None if device is None else Path(device)
        if path is not None and path.exists() and stat.S_ISCHR(path.stat().st_mode) and not path.is_symlink():
            self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            _set_up_port(self._fd, self.settings)
            return str(path)
        # Both ends stay open here: without the client's end, reading would fail whenever no client is there.
        self._fd, self._client_end = os.openpty()
        tty.setraw(self._client_end)
        name = os.ttyname(self._client_end)
        if path is None:
            return name
        if path.is_symlink():
            path.unlink()
        path.symlink_to(name)
        self._link = path
        return str(path)

    def _readable(self) -> None:
        try:
            data = os.read(self._fd, READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self._loop.remove_reader(self._fd)  # a port that was pulled out
            return
        # A pseudo-terminal hands over at once what the line would carry byte by byte.
        self._arrived_s = max(self._arrived_s, time.monotonic()) + len(data) * self.settings.character_s
        if self.settings.echo:
            self._write(data)
        self._received += data
        self._ready.set()

    def _write(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError, OSError):  # nobody reads: a line does not wait either
            os.write(self._fd, data)


def _set_up_port(fd: int, settings: SerialSettings) -> None:
    speed = getattr(termios, f"B{settings.baud}", None)
    if speed is None:
        raise OSError(0, f"this system has no speed of {settings.baud} baud")
    tty.setraw(fd)
    attributes = termios.tcgetattr(fd)
    flags = attributes[2] & ~(termios.PARENB | termios.PARODD | termios.CSTOPB)
    flags |= {"N": 0, "E": termios.PARENB, "O": termios.PARENB | termios.PARODD}[settings.parity]
    attributes[2] = flags | (termios.CSTOPB if settings.stopbits == 2 else 0) | termios.CLOCAL | termios.CREAD
    attributes[4] = attributes[5] = speed
    termios.tcsetattr(fd, termios.TCSANOW, attributes)
