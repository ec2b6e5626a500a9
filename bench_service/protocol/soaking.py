"""A soak: no current until the chamber's air and the cell have had one temperature for a while."""

from __future__ import annotations

from bench_service.errors import Where
from bench_service.protocol.counters import Ending
from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.laws import Seen
from bench_service.protocol.program import Play, Window
from bench_service.protocol.steps import Soak

_TOLERANCE_S = 1e-6


class Soaking:
    """Whether a soak is over; belongs to one step, and begins anew where that is taken up again.

    Parameters
    ----------
    rule : Soak
    air_within_K : float
        How near to the set point the air must be.
    """

    __slots__ = ("_air_within_K", "_rule", "_since_s", "_time_s")

    def __init__(self, rule: Soak, air_within_K: float) -> None:
        self._rule = rule
        self._air_within_K = air_within_K
        self._time_s = 0.0
        self._since_s: float | None = None

    def see(self, seen: Seen) -> tuple[Ending | None, str | None]:
        """Take a sample; return how the step has ended (None: it goes on), or why the protocol must not go on."""
        rule, goal_degC = self._rule, self._rule.temperature_degC
        self._time_s += seen.interval_s
        # A temperature that is missing (NaN) is not near.
        near = abs(seen.ambient_degC - goal_degC) <= self._air_within_K
        if not (near and abs(seen.temperature_degC - goal_degC) <= rule.within_K):
            self._since_s = None
        elif self._since_s is None:
            self._since_s = self._time_s
        if self._since_s is not None and self._time_s - self._since_s >= rule.hold_s - _TOLERANCE_S:
            return Ending.SOAKED, None
        if self._time_s < rule.limit_s - _TOLERANCE_S:
            return None, None
        if rule.goes_on:
            return Ending.TIME, None
        return None, (
            f"not at {goal_degC:g} degC after {rule.limit_s:g} s: the chamber's air is {seen.ambient_degC:.4g} degC, "
            f"the cell {seen.temperature_degC:.4g} degC; check chamber and sensors, or give limit_s more"
        )


def soaking_of(play: Play, window: Window) -> Soaking | None:
    """Return the soak that a step is; None where it is none."""
    if play.soak is None:
        return None
    return Soaking(play.soak, play.soak.within_K if window.chamber is None else window.chamber.tolerance_K)


def check_chamber(window: Window, kind: str, temperature_degC: float, where: Where) -> None:
    """Refuse a step that needs a chamber where there is none, or one that goes beyond its window.

    Raises
    ------
    ProtocolError
        Naming the step.
    """
    numbers = ".".join(str(each + 1) for each in where if isinstance(each, int))
    if window.chamber is None:
        raise ProtocolError(
            f"step {numbers} ({kind}) needs a temperature chamber, and the bench has none", where,
            remedy="take the step out, or give the bench a chamber (docs/cyclers.md)",
        )  # fmt: skip
    low, high = window.chamber.temperature_degC
    if not low <= temperature_degC <= high:
        raise ProtocolError(
            f"step {numbers} ({kind}): set point outside the chamber's window", (*where, "temperature_degC"),
            value=temperature_degC, unit="degC", limit=(low, high), remedy="stay inside",
        )  # fmt: skip
