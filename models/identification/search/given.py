"""A structure that a person gives: kept as it is; only poles and the number of local models are chosen."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from models.network.structure import Structure

_POLES_S = (4.0, 10.0, 25.0, 60.0)
_FAST_OVER_SLOW = 1.0 / 8.0
_SIZES = (6, 12, 18, 24, 30, 36)


@dataclass(frozen=True)
class GivenCandidate:
    """One set of choices within a given structure.

    Attributes
    ----------
    given : the structure
    poles_s : time constants of the shared poles, one for each past output
    n_models : number of local models asked for
    """

    given: Structure
    poles_s: tuple[float, ...]
    n_models: int = 12

    def structure(self, dt_s: float) -> Structure:
        """Return the structure that was given, at the sampling time of the runs."""
        return replace(self.given, dt_s=dt_s)

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types."""
        return {"structure": asdict(self.given)["name"], "poles_s": list(self.poles_s), "n_models": self.n_models}

    def __str__(self) -> str:
        """Say in a few words what is tried."""
        return f"the given structure, {self.n_models} local models"


def poles_for(order: int, slow_s: float, fastest_s: float) -> tuple[float, ...]:
    """Time constants for an output order, the slowest last."""
    if order == 0:
        return ()
    slow_s = max(slow_s, fastest_s)
    return (slow_s,) if order == 1 else (max(_FAST_OVER_SLOW * slow_s, fastest_s), slow_s)


def pole_alternatives(best: GivenCandidate, fastest_s: float) -> list[GivenCandidate]:
    """Candidates with other poles."""
    order = best.given.output_order
    return [replace(best, poles_s=poles_for(order, slow, fastest_s)) for slow in _POLES_S]


def size_alternatives(best: GivenCandidate) -> list[GivenCandidate]:
    """Candidates with other numbers of local models; a partition that must not be split has none."""
    splittable = any(axis.splittable for axis in best.given.axes)
    return [replace(best, n_models=size) for size in _SIZES] if splittable else [best]
