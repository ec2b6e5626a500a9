"""How long work tells how far it is."""

from __future__ import annotations

from collections.abc import Callable

# Called with a share 0..1 and a short text.
Progress = Callable[[float, str], None]


def silent(_share: float, _text: str) -> None:
    """Tell nobody."""


def part_of(progress: Progress, start: float, share: float) -> Progress:
    """Progress of a part of the work that begins at `start` and takes that share of it all."""
    return lambda done, text: progress(start + share * done, text)
