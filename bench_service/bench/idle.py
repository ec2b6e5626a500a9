"""Supervision of a bench between runs."""

from collections.abc import Callable

from bench_service.bench.at_rest import AtRest, Notice, look
from bench_service.bench.cycler_keeper import CyclerKeeper
from bench_service.bench.live import LiveFeed
from bench_service.bench.plausibility import band_of
from bench_service.bench.rest import bring_to_rest
from bench_service.bench.settings import BenchSettings
from drivers.cycler import CyclerError, Reading


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

    async def sample(self, keeper: CyclerKeeper, feed: LiveFeed, around: Callable[[Reading], Reading]) -> list[Notice]:
        """Look at the cycler; an output that is on is switched off, one that does not answer is let go.

        Parameters
        ----------
        keeper : CyclerKeeper
        feed : LiveFeed
        around : callable
            Puts into a reading what is measured around the cell.

        Returns
        -------
        What is new.
        """
        if (cycler := keeper.cycler) is None:
            return []
        try:
            reading = await cycler.sample()
        except CyclerError as error:
            await keeper.disconnect(str(error))
            return []
        if feed.due:
            feed.send(around(reading))
        notices = self.look(reading)
        if reading.output_on and (unrested := await bring_to_rest(cycler)) is not None:
            await keeper.disconnect(unrested)
        return notices

    def forget(self) -> None:
        """Begin anew: after a run, or when somebody has acknowledged, what holds still is said again."""
        self._state = AtRest()
