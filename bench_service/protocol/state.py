"""Where a protocol stands: enough to go on from there; and the steps that lie behind it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Self

from bench_service.protocol.counters import Counters, Ending
from bench_service.protocol.laws import Seen


@dataclass(slots=True)
class Standing:
    """Where a protocol stands.

    Attributes
    ----------
    at : int
        Instruction that plays, or is next.
    counters : list of int
        Of loops and jumps: how often each has been gone through.
    step_count, cycle_count : int
        From 1; the step that plays, the cycle that it belongs to.
    fresh : bool
        Whether the cycle has no step yet.
    step, total : Counters
        Of the step that plays, and of all steps before it; a protocol that is taken up again counts on.
    chamber_degC : float or None
        Set point of the chamber; None: the protocol has not set it.
    """

    at: int = 0
    counters: list[int] = field(default_factory=list)
    step_count: int = 0
    cycle_count: int = 1
    fresh: bool = True
    step: Counters = field(default_factory=Counters)
    total: Counters = field(default_factory=Counters)
    chamber_degC: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Return what `from_json` reads."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        """Read what `to_json` wrote; raises `ValueError`."""
        try:
            own = {"counters": list(data["counters"])}  # whoever plays from here counts on in it
            parts = {name: Counters(**data[name]) for name in ("step", "total")}
            return cls(**{**data, **own, **parts})
        except (KeyError, TypeError) as error:
            raise ValueError(f"standing of a protocol: {error}") from error


@dataclass(frozen=True, slots=True)
class StepEnd:
    """A step that has ended, and what it has moved.

    Attributes
    ----------
    step_index : int
        Number of the step in the document, from 1.
    at : int
        Its instruction.
    """

    step_count: int
    step_index: int
    cycle_count: int
    at: int
    ended_by: Ending
    moved: Counters
    last: Seen
