"""The search where inputs and partition variables are fixed: one choice after the other, each with the best so far."""

from __future__ import annotations

from dataclasses import dataclass, replace

from models.identification.search.candidate import Candidate
from models.identification.search.chooser import Chooser

_RELAXATION_S = (100.0, 300.0, 600.0, 1000.0, 3000.0)
_POLES_S = (4.0, 10.0, 25.0, 60.0)
_CURRENT_ORDERS = (1, 2, 3)
_SOC_K_SIGMA = (0.35, 0.5, 0.7, 1.0)
_TEMPERATURE_K_SIGMA = (0.45, 0.6, 0.85, 1.2, 2.0)
_SIZES = (6, 12, 18, 24, 30, 36)
_FINER = (0.5, 0.7, 1.4, 2.0)


@dataclass(frozen=True)
class FixedInputsSearch:
    """The search over orders, time constants, sharpness and size.

    Attributes
    ----------
    chooser : of the candidates
    fastest_s : the fastest pole that the sampling time can show
    temperature_parts : of the temperature axis of "full"
    """

    chooser: Chooser
    fastest_s: float
    temperature_parts: int

    def best(self, family: str) -> Candidate:
        """Choose one thing after the other, twice, and return the best candidate of "full" or "minimal"."""
        choose = self.chooser.choose
        best = Candidate(family, (self._slow_enough(25.0),), temperature_parts=self.temperature_parts)
        relaxations = _RELAXATION_S if family == "full" else (best.relaxation_s,)
        # A curve that few local models do not resolve would be mistaken for slow relaxation.
        best = choose(best, [replace(best, n_models=size) for size in _SIZES], 0.0)
        best = choose(
            best, [replace(best, relaxation_s=r, poles_s=(p,)) for r in relaxations for p in self._slow()], 0.0
        )
        best = self._pass(best, 0.2)
        self.chooser.judge.begin_again()
        return self._pass(best, 0.6)

    def _pass(self, best: Candidate, done: float) -> Candidate:
        choose, full = self.chooser.choose, best.family == "full"
        best = choose(best, [replace(best, n_models=size) for size in _SIZES], done + 0.2)
        if full:
            best = choose(best, [replace(best, relaxation_s=r) for r in _RELAXATION_S], done + 0.22)
        best = choose(best, [replace(best, poles_s=(*best.poles_s[:-1], pole)) for pole in self._slow()], done + 0.24)
        best = choose(best, [replace(best, current_order=m) for m in _CURRENT_ORDERS], done + 0.25)
        fast = self._slow_enough(best.poles_s[-1] / 8.0)
        if fast < 0.5 * best.poles_s[-1]:
            two = [replace(best, poles_s=(fast, best.poles_s[-1]), current_order=m) for m in _CURRENT_ORDERS[1:]]
            best = choose(best, two, done + 0.28)
        best = choose(best, [replace(best, soc_k_sigma=k) for k in _SOC_K_SIGMA], done + 0.3)
        if full and self.temperature_parts > 1:
            best = choose(best, [replace(best, temperature_k_sigma=k) for k in _TEMPERATURE_K_SIGMA], done + 0.33)
        if full:
            best = choose(best, [replace(best, relaxation_s=f * best.relaxation_s) for f in _FINER], done + 0.36)
        slower = [replace(best, poles_s=(*best.poles_s[:-1], self._slow_enough(f * best.poles_s[-1]))) for f in _FINER]
        return choose(best, slower, done + 0.38)

    def _slow(self) -> list[float]:
        """Poles that are offered, as far as the sampling time can show them."""
        return sorted({self._slow_enough(pole) for pole in _POLES_S})

    def _slow_enough(self, time_constant_s: float) -> float:
        return max(time_constant_s, self.fastest_s)
