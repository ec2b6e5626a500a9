"""What keeps a bench from its next run until it is acknowledged, and whether that takes a person."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

LatchCode = Literal[
    "interrupted",  # something outside the cell has cut a run off
    "recorder",  # the samples of a run could not be stored
    "run_fault",  # a rule has ended a run, or its cycler
    "commissioning",  # it failed with current flowing
    "at_rest",  # something is wrong though nothing runs
    "other_device",  # another cycler than before
    "unknown",  # an earlier version has written it down
]
# Of the house, not of the cell: whoever has declared that a run goes on by itself has acknowledged these before.
INTERRUPTIONS = frozenset[str]({"interrupted", "recorder"})
OF_RUNS = INTERRUPTIONS | {"run_fault"}
# How a run says that its recorder has gone.
NOT_STORED = "samples cannot be stored"


@dataclass(frozen=True, slots=True)
class Latch:
    """A fault that is latched.

    Parameters
    ----------
    code : str
        One of `LatchCode`.
    text : str
        For people.
    """

    code: str
    text: str

    @classmethod
    def of_run(cls, state: str, reason: str | None, text: str | None = None) -> Self | None:
        """Return what the end of a run leaves latched, in other words where `text` has them; None: nothing."""
        if state not in ("fault", "interrupted"):
            return None
        ended = "recorder" if NOT_STORED in (reason or "") else "run_fault"
        return cls("interrupted" if state == "interrupted" else ended, text or reason or f"the run ended as {state}")

    @classmethod
    def from_json(cls, data: Mapping[str, Any] | None) -> Self | None:
        """Read what ``dataclasses.asdict`` gave."""
        return None if data is None else cls(**data)

    def over(self, before: "Latch | None") -> "Latch":
        """Return what is latched where this comes while `before` is.

        What takes a person is never hidden by what does not, and another device by nothing: the first of two equal
        ones stays.
        """
        return self if before is None or _rank(self) > _rank(before) else before


def _rank(latch: Latch) -> int:
    return 0 if latch.code in OF_RUNS else 2 if latch.code == "other_device" else 1
