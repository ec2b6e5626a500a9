"""The search where the data choose inputs and partition: from a circuit's terms, and from a network's."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from models.data.metrics import noise_floor_V
from models.identification.search.auto import AutoCandidate, alternatives, find_offer, first_candidate, stands_apart
from models.identification.search.chooser import Chooser
from models.identification.search.circuit_start import circuit_alternatives, circuit_starts
from models.network.regression import SignalBank

# Held-out errors that differ by less than this share are alike: errors hang together over hundreds of samples.
_ALIKE = 0.04
# Nothing simulates better than the measurement's noise. A held-out error of that many times the noise is at it: its
# parameters cost a few percent on the samples of the search, and the noise is not known better.
_AT_THE_NOISE = 1.1


@dataclass
class ChosenInputsSearch:
    """The search over everything that the training runs can tell apart."""

    chooser: Chooser
    _apart: dict[tuple[object, ...], bool] = field(default_factory=dict)

    def best(self) -> AutoCandidate:
        """Return the best candidate."""
        judge, capacity_Ah = self.chooser.judge, self._bank.cell.capacity_Ah
        offer = find_offer(self._bank)
        circuit = self._circuit(offer.warm)
        if circuit is not None and self._error_V(circuit) < _AT_THE_NOISE * self._noise_floor_V():
            return circuit
        best = first_candidate(capacity_Ah, offer)
        for done in (0.1, 0.55):
            before, stage = best, 0
            while tried := alternatives(best, offer, stage):
                best = self.chooser.choose(best, tried, done + 0.02 * stage)
                stage += 1
            best = self._moved(best, done + 0.4)
            if best == before:
                break
        # Of two that simulate alike the circuit, whose few constants were moved until they fit.
        if circuit is not None and self._error_V(circuit) < (1.0 + _ALIKE) * judge.error_V(best, best):
            return circuit
        return best

    def _circuit(self, warm: bool) -> AutoCandidate | None:
        """Search from an equivalent circuit's terms; None where the runs cannot tell them."""
        starts = [each for each in circuit_starts(self._bank.cell.capacity_Ah, warm) if self._stands_apart(each)]
        if not starts:
            return None
        circuit, stage = min((self._moved(each, 0.02) for each in starts), key=self._error_V), 0
        while (tried := circuit_alternatives(circuit, warm, stage)) is not None:
            self.chooser.progress(0.04 + 0.01 * stage, f"trying {circuit}")
            # No change is too small: constants are moved, not terms added.
            apart = [each for each in tried if self._stands_apart(each)]
            judge = self.chooser.judge
            errors = {each: judge.error_V(each, circuit) for each in dict.fromkeys([circuit, *apart])}
            chosen = min(errors, key=errors.__getitem__)
            circuit, stage = self._moved(chosen, 0.05) if chosen != circuit else circuit, stage + 1
        return circuit

    def _moved(self, best: AutoCandidate, share_done: float) -> AutoCandidate:
        self.chooser.progress(share_done, f"moving the constants of {best}")
        return self.chooser.judge.moved(best, self._stands_apart)

    def _stands_apart(self, candidate: AutoCandidate) -> bool:
        key = (max(candidate.time_constants_s), candidate.hysteresis_rates)
        if key not in self._apart:
            self._apart[key] = stands_apart(candidate, self._bank)
        return self._apart[key]

    def _noise_floor_V(self) -> float:
        """Median over the runs; 0 where no run is steady for long enough to show it."""
        floors = np.array([noise_floor_V(run.voltage_V, run.current_A) for run in self._bank.runs])
        return float(np.median(floors[np.isfinite(floors)])) if np.isfinite(floors).any() else 0.0

    def _error_V(self, candidate: AutoCandidate) -> float:
        return self.chooser.judge.error_V(candidate, candidate)

    @property
    def _bank(self) -> SignalBank:
        return self.chooser.judge.bank
