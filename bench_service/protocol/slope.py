"""How fast the voltage moves, over a stated time: the difference of the means of its two halves."""

from __future__ import annotations

from collections import deque

_POINTS = 60


class Slope:
    """The slope over the last `over_s` seconds of one step."""

    __slots__ = ("_every_s", "_over_s", "_points")

    def __init__(self, over_s: float) -> None:
        self._over_s = over_s
        self._every_s = over_s / _POINTS
        self._points: deque[tuple[float, float]] = deque()

    def see(self, time_s: float, voltage_V: float) -> float | None:
        """Take a sample; return the slope in V/s, None where there is too little of it."""
        points = self._points
        if points and time_s - points[-1][0] < self._every_s:
            return None
        points.append((time_s, voltage_V))
        while len(points) > 1 and points[1][0] <= time_s - self._over_s:
            points.popleft()
        if time_s - points[0][0] < self._over_s * 0.95 or len(points) < 2:
            return None
        half = len(points) // 2
        early, late = [p for k, p in enumerate(points) if k < half], [p for k, p in enumerate(points) if k >= half]
        (t1, v1), (t2, v2) = _mean(early), _mean(late)
        return (v2 - v1) / (t2 - t1)


def _mean(points: list[tuple[float, float]]) -> tuple[float, float]:
    return sum(t for t, _ in points) / len(points), sum(v for _, v in points) / len(points)
