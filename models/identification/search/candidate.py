"""One set of choices for a structure of which only orders, time constants, sharpness and size are open."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, TypeVar

from models.identification.search.auto import AutoCandidate
from models.identification.search.given import GivenCandidate
from models.network.structure import TEMPERATURE_PARTS, Structure, full_structure, minimal_structure


@dataclass(frozen=True)
class Candidate:
    """One set of choices.

    Attributes
    ----------
    family : "full" or "minimal"
    poles_s : time constants of the shared poles
    current_order : taps of the current beyond the present one
    relaxation_s : time constant of the relaxation input
    soc_k_sigma, temperature_k_sigma : sharpness of the validity functions
    temperature_parts : parts of the temperature axis; runs of one temperature tell nothing of more than one
    n_models : number of local models asked for
    """

    family: str
    poles_s: tuple[float, ...] = (25.0,)
    current_order: int = 2
    relaxation_s: float = 600.0
    soc_k_sigma: float = 0.7
    temperature_k_sigma: float = 1.2
    temperature_parts: int = TEMPERATURE_PARTS
    n_models: int = 12

    def structure(self, dt_s: float) -> Structure:
        """Build the structure that these choices stand for."""
        order = len(self.poles_s)
        if self.family == "minimal":
            return minimal_structure(dt_s, order, self.current_order, self.soc_k_sigma)
        return full_structure(
            dt_s,
            order,
            self.current_order,
            self.relaxation_s,
            self.soc_k_sigma,
            self.temperature_k_sigma,
            self.temperature_parts,
        )

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types."""
        return asdict(self) | {"poles_s": list(self.poles_s)}

    def __str__(self) -> str:
        """Say in a few words what is tried."""
        poles = " and ".join(f"{pole:g} s" for pole in self.poles_s)
        relaxation = f", relaxation {self.relaxation_s:g} s" if self.family == "full" else ""
        return f"poles {poles}{relaxation}, {self.n_models} local models"


Choice = Candidate | AutoCandidate | GivenCandidate
ChoiceT = TypeVar("ChoiceT", Candidate, AutoCandidate, GivenCandidate)
