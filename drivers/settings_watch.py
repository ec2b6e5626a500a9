"""Does the device still have the settings that it was given? Pure: which part is read next, what a difference means.

Two programs that steer one cycler undo each other's limits; neither would notice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivers.modbus_commands import Write


class SettingsWatch:
    """Goes through what was written, part by part.

    Parameters
    ----------
    settings : sequence of Write
        As they were written.
    heartbeat : Write or None
        Of the register that only this driver should move; its value is that of the call.
    """

    def __init__(self, settings: Sequence[Write] = (), heartbeat: Write | None = None) -> None:
        self._parts = [*settings, *([] if heartbeat is None else [heartbeat])]
        self._heartbeat = heartbeat
        self._at = -1

    def next(self, heartbeat: int) -> Write | None:
        """Return what must be read now; None where there is nothing."""
        if not self._parts:
            return None
        self._at = (self._at + 1) % len(self._parts)
        part = self._parts[self._at]
        if part is not self._heartbeat:
            return part
        words = len(part.values)
        return replace(part, values=tuple(heartbeat >> 16 * (words - 1 - k) & 0xFFFF for k in range(words)))


def foreign(address: str, differences: Sequence[str]) -> str | None:
    """Return what is said of settings that are not as they were written."""
    if not differences:
        return None
    return f"{address}: {', '.join(differences)}: another program writes to this device; only one must steer it"
