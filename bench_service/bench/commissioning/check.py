"""What a commissioning finds, point by point, and what is asked of it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, Self

from bench_service.bench.latch import Latch

Outcome = Literal["passed", "failed", "absent"]


@dataclass(frozen=True, slots=True)
class Check:
    """One point that was looked at.

    Parameters
    ----------
    name : str
    outcome : str
        ``absent``: this device cannot show it, or it cannot be shown without harm; that alone is no failure.
    text : str
        For people, with values, units and limits.
    values : mapping of str to float
        The figures behind it; names carry units.
    """

    name: str
    outcome: Outcome
    text: str
    values: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Return it as plain types."""
        return asdict(self) | {"values": dict(self.values)}


@dataclass(frozen=True, slots=True)
class ProofOrder:
    """What is to be done.

    Parameters
    ----------
    prove : bool
        False: the device is read and nothing is written.
    current_A : float or None
        Size of the pulses; None: a fifth of the capacity in one hour, within half of the bench's limits.
    resistor_Ohm : float or None
        A known resistor is connected in place of a cell; current then flows one way only.
    settle_s : float
        Time that the current has to reach its set-point.
    """

    prove: bool = False
    current_A: float | None = None
    resistor_Ohm: float | None = None
    settle_s: float = 1.0

    def to_json(self) -> dict[str, Any]:
        """Return what `from_json` reads."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """Read what `to_json` wrote; raises `ValueError`."""
        try:
            return cls(**data)
        except TypeError as error:
            raise ValueError(f"commissioning order: {error}") from error


@dataclass(frozen=True, slots=True)
class Report:
    """How a commissioning went.

    Parameters
    ----------
    state : str
        ``passed``, ``failed``, ``stopped``, ``refused``, or ``probed`` where nothing was to be proved.
    reason : str or None
    checks : tuple of Check
    identity : mapping of str to str
        What the device says of itself; empty where there was none.
    latch : Latch or None
        A fault that somebody must look at before the next run.
    chamber : mapping of str to str, or None
        What the temperature chamber says of itself; None where there is none.
    """

    state: str
    reason: str | None = None
    checks: tuple[Check, ...] = ()
    identity: Mapping[str, str] = field(default_factory=dict)
    latch: Latch | None = None
    chamber: Mapping[str, str] | None = None

    def to_json(self) -> dict[str, Any]:
        """Return it as plain types, without what concerns the bench alone."""
        chamber = {} if self.chamber is None else {"chamber": dict(self.chamber)}
        return {
            "state": self.state,
            "reason": self.reason,
            "identity": dict(self.identity),
            **chamber,
            "checks": [check.to_json() for check in self.checks],
        }


def failed(checks: tuple[Check, ...] | list[Check]) -> str | None:
    """Return what has failed, in words; None where nothing has."""
    return "; ".join(f"{check.name}: {check.text}" for check in checks if check.outcome == "failed") or None
