"""Times as a person says them."""

from __future__ import annotations

_MINUTE_S, _HOUR_S, _DAY_S = 60.0, 3600.0, 86400.0


def in_words(seconds: float) -> str:
    """Write a finite time: "9.5 s", "40 s", "20 min", "2 h 5 min", "14 days"."""
    if seconds < 2 * _MINUTE_S:
        return f"{seconds:.3g} s" if seconds < 10.0 else f"{seconds:.0f} s"
    if seconds < 2 * _HOUR_S:
        return f"{seconds / _MINUTE_S:.0f} min"
    if seconds < 3 * _DAY_S:
        hours, minutes = divmod(round(seconds / _MINUTE_S), 60)
        return f"{hours} h {minutes} min" if minutes else f"{hours} h"
    return f"{seconds / _DAY_S:.1f}".removesuffix(".0") + " days"
