"""What can go wrong between the bench and a cycler; a file of its own so that reading a map needs no driver."""

from __future__ import annotations

from pathlib import Path
from typing import Any


class CyclerError(Exception):
    """Root of everything a driver raises."""


class CyclerConnectionError(CyclerError):
    """The link is not there: refused, closed by the device, or closed by the driver after a time-out."""


class CyclerTimeoutError(CyclerError):
    """The device did not answer in time; the link is closed, so that its late answer finds no reader."""


class CyclerProtocolError(CyclerError):
    """The device answered, but with an exception, a wrong length, a wrong identity or an impossible value."""


class SetPointRefusedError(CyclerError):
    """A value was refused: by the codec before it was sent, or by the device after it was sent.

    Attributes
    ----------
    reading : Reading or None
        The sample in which the refusal was seen, so that it can still be recorded.
    """

    def __init__(self, message: str, reading: Any = None) -> None:
        super().__init__(message)
        self.reading = reading


class BadMapError(CyclerError):
    """A device map that cannot be used.

    Attributes
    ----------
    file, key, reason : str
        Which file, which key in it (dotted), and what is wrong with it.
    """

    def __init__(self, file: str | Path, key: str, reason: str) -> None:
        super().__init__(f"{file}: {key}: {reason}")
        self.file, self.key, self.reason = str(file), key, reason
