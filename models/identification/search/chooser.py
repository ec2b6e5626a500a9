"""One choice among several: the candidate with the least held-out error, where the change is worth it."""

from __future__ import annotations

from dataclasses import dataclass

from models.identification.progress import Progress
from models.identification.search.candidate import ChoiceT
from models.identification.search.judge import Judge

# A change must lower the held-out error by this share to be made.
_WORTH = 0.005


@dataclass(frozen=True)
class Chooser:
    """Chooses by a judge, and tells what is tried."""

    judge: Judge
    progress: Progress

    def choose(self, current: ChoiceT, candidates: list[ChoiceT], share_done: float) -> ChoiceT:
        """Return the best; the present choice stays unless another is worth the change."""
        errors = {}
        for candidate in dict.fromkeys([current, *candidates]):
            self.progress(share_done, f"trying {candidate}")
            errors[candidate] = self.judge.error_V(candidate, current)
        best = min(errors, key=errors.__getitem__)
        return best if errors[best] < errors[current] * (1.0 - _WORTH) else current
