"""The order to hold a run, given from outside the loop, and what has become of it."""

from collections.abc import Callable


class PauseSwitch:
    """What is wanted, and what is so.

    Parameters
    ----------
    on_change : callable or None
        Called when a run is held or goes on.

    Attributes
    ----------
    wanted : bool
        Whether the run is to be held.
    skip_wanted : bool
        Whether the step that plays is to end.
    active : bool
        Whether it is: the output is off, and verified to be.
    """

    def __init__(self, on_change: Callable[[], None] | None = None) -> None:
        self._on_change = on_change
        self.wanted = False
        self.skip_wanted = False
        self.active = False

    def take(self, operation: str) -> None:
        """Take an order: ``pause``, ``resume``, or ``skip`` the step of a protocol that plays."""
        if operation == "skip":
            self.skip_wanted = True
        else:
            self.wanted = operation == "pause"

    def note(self, *, active: bool) -> None:
        """Say that the run is held, or goes on."""
        self.active = active
        if self._on_change is not None:
            self._on_change()
