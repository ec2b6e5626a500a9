"""Supervision of a bench between runs."""

from bench_service.bench.at_rest import AtRest, Notice, look
from bench_service.bench.plausibility import band_of
from bench_service.bench.settings import BenchSettings
from drivers.cycler import Reading


class IdleWatch:
    """Looks at the readings between runs; what has been said once is not said again while it holds.

    Parameters
    ----------
    settings : BenchSettings
    """

    def __init__(self, settings: BenchSettings) -> None:
        self._settings = settings
        self._band = band_of(settings.capacity_Ah, settings.limits.voltage_V, settings.resistance_Ohm)
        self._state = AtRest()

    def look(self, reading: Reading) -> list[Notice]:
        """Take a reading; give what is new."""
        self._state, notices = look(self._state, self._settings.name, self._settings.limits, self._band, reading)
        return notices

    def forget(self) -> None:
        """Begin anew: after a run, or when somebody has acknowledged, what holds still is said again."""
        self._state = AtRest()
