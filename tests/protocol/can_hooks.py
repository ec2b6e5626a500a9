"""A fault hook for the next frames that a simulated node gets."""

from __future__ import annotations

from collections.abc import Mapping

from simulators.can_bus import CanAction
from simulators.can_node import OnFrame


def on(message: str, action: CanAction, *, item: int | None = None, times: int = 1) -> OnFrame:
    """Act on the next frames of one name, then let everything pass."""
    left = [times]

    def hook(name: str, raws: Mapping[str, float]) -> CanAction | None:
        if name != message or left[0] == 0 or (item is not None and raws["Item"] != item):
            return None
        left[0] -= 1
        return action

    return hook
