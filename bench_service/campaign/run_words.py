"""What is told of a run, in words."""

from __future__ import annotations

from bench_service.bench.request import RunRequest


def gain(request: RunRequest) -> str:
    """Say with which gain the observer runs, where somebody has chosen one: its estimates depend on it."""
    chosen = request.observer and (request.observer["settings"] or {}).get("gain")
    return "" if chosen is None else f", observer with {chosen} gain"


def length(request: RunRequest) -> str:
    """Return how long a run takes, in words."""
    if request.protocol is None:
        return f"{float(request.time_s[-1]):g} s"
    expected_s = request.protocol["expected_s"]
    return "a protocol of unknown length" if expected_s is None else f"a protocol of about {expected_s / 3600.0:.2g} h"
