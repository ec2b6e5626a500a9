"""The observer in a run: one row a sample, and what people must know of it."""

from collections.abc import Callable

from bench_service.bench.observer_link import NO_ESTIMATE, ObserverError, ObserverLink, ObserverRow
from drivers.cycler import Reading


class Observing:
    """Steps an observer until it fails.

    Its state of charge is for people; no limit depends on it, so a run goes on without it.

    Parameters
    ----------
    observer : ObserverLink or None
    notify : callable
        Takes severity, code and text.

    Attributes
    ----------
    active : bool
        Whether it still works.
    row : ObserverRow
        The last estimate.
    """

    def __init__(self, observer: ObserverLink | None, notify: Callable[[str, str, str], None]) -> None:
        self._observer = observer
        self._notify = notify
        self.row = NO_ESTIMATE

    @property
    def active(self) -> bool:  # noqa: D102
        return self._observer is not None

    def step(self, reading: Reading) -> None:
        """Take a sample."""
        self.row = self._stepped(reading)

    def _stepped(self, reading: Reading) -> ObserverRow:
        if self._observer is None:
            return NO_ESTIMATE
        try:
            row = self._observer.step(
                reading.current_A, reading.voltage_V, reading.temperature_degC, reading.ambient_degC
            )
            for reason in self._observer.new_alarms():
                self._notify("warning", "observer", reason)
            return row
        except ObserverError as error:
            self._observer = None
            self._notify("warning", "observer", f"{error}; its state of charge is invalid from now on")
            return NO_ESTIMATE
