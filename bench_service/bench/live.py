"""The live feed to the API: at most ten frames a second, dropped where the link is full, never waiting."""

import math
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from bench_service.bench.links import FrameLink
from drivers.cycler import Reading

_PERIOD_S = 0.1
_LATENESS_TICKS = 1000


class LiveFeed:
    """Thins samples out for people to look at.

    Parameters
    ----------
    link : FrameLink
        Command link to the API.
    monotonic : callable
        Seconds; the feed is paced by wall time in lock-step too.
    more : callable
        Gives what every frame tells beside the reading.
    """

    def __init__(
        self,
        link: FrameLink,
        monotonic: Callable[[], float] = time.monotonic,
        more: Callable[[], dict[str, Any]] = dict,
    ) -> None:
        self._link = link
        self._more = more
        self._monotonic = monotonic
        self._next_s = -math.inf
        self._lateness_s: deque[float] = deque(maxlen=_LATENESS_TICKS)

    def restart(self) -> None:
        """Forget the lateness of an earlier run."""
        self._lateness_s.clear()

    def note_lateness(self, lateness_s: float) -> None:
        """Count the lateness of a tick."""
        self._lateness_s.append(lateness_s)

    @property
    def due(self) -> bool:
        """Whether a frame would be sent now."""
        return self._monotonic() >= self._next_s and self._link.idle

    def send(self, reading: Reading, **run: Any) -> None:
        """Send a frame with what `reading` measured; `run` adds to it or replaces.

        NaN is sent as null. The caller asks `due` first.
        """
        self._next_s = self._monotonic() + _PERIOD_S
        frame = {
            "run_id": None,
            "seq": None,
            "time_s": None,
            "voltage_V": reading.voltage_V,
            "current_A": reading.current_A,
            "temperature_degC": reading.temperature_degC,
            "ambient_degC": reading.ambient_degC,
            "setpoint_A": reading.setpoint_in_force_A,
            "soc": None,
            "soc_std": None,
            "progress": None,
            "missed_ticks": 0,
            "lateness_p99_s": self._lateness_p99_s(),
        }
        frame |= self._more() | run
        self._link.send({"op": "live"} | {name: _finite(value) for name, value in frame.items()})

    def _lateness_p99_s(self) -> float | None:
        if not self._lateness_s:
            return None
        ordered = sorted(self._lateness_s)
        return ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))]


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
