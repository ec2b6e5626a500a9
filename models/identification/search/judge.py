"""The held-out error of candidates on one set of training runs: what each is judged by, found once and kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from models.data.timeseries import FloatArray
from models.identification.lolimot import grow_partitions
from models.identification.search.auto import AutoCandidate
from models.identification.search.candidate import Choice
from models.identification.search.fitted import span_V
from models.identification.search.growing import Growing
from models.identification.search.moved_constants import held_out_errors, moved
from models.identification.search.samples import KeptSamples, SampleBank
from models.identification.shared_poles import compare, output_coefficients, penalties
from models.network.model_record import Json
from models.network.partition import Partition
from models.network.regression import VOLTAGE, SignalBank
from models.network.structure import Structure

# Samples in the sums while candidates are compared.
_SEARCH_SAMPLES = 6_000
# More local models than any candidate asks for.
_MOST_MODELS = 1000


@dataclass
class Judge:
    """Judges candidates on the runs of a bank of signals."""

    bank: SignalBank
    _rows: dict[Choice, Json] = field(default_factory=dict)
    _known: dict[Choice, float] = field(default_factory=dict)
    _boxes: dict[tuple[object, ...], Growing] = field(default_factory=dict)
    _strengths: dict[Choice, tuple[float, ...]] = field(default_factory=dict)

    @property
    def dt_s(self) -> float:
        """Sampling time of the runs' grid in s."""
        return self.bank.runs[0].dt_s

    @property
    def table(self) -> list[Json]:
        """Documents of what was tried, each with its held-out error."""
        return list(self._rows.values())

    def strengths(self, candidate: Choice) -> tuple[float, ...] | None:
        """Strengths of the penalties that a candidate was judged with; None where it was not judged."""
        return self._strengths.get(candidate)

    def error_V(self, candidate: Choice, current: Choice) -> float:
        """Free-run RMSE in V on held-out samples, of a fit to fewer samples; `current` is the choice so far."""
        if candidate not in self._known:
            structure, poles_s = candidate.structure(self.dt_s), candidate.poles_s
            kept = self._samples.take(structure, poles_s)
            partition = self._boxes_of(structure, kept, candidate.n_models)
            forms = penalties(structure, partition, kept.data, output_coefficients(poles_s, self.dt_s))
            # The penalties that serve the present choice are near those of its neighbours.
            span = span_V({VOLTAGE: self.bank.bounds(VOLTAGE)})
            hopeless_mse = (self._known.get(current, np.inf) / span) ** 2
            found = compare(kept.moments(partition), forms, self._strengths.get(current), hopeless_mse)
            self._strengths[candidate] = found[0]
            self._known[candidate] = float(np.sqrt(found[1])) * span
            row = {"n_models_built": partition.n_models, "held_out_rmse_mV": 1e3 * self._known[candidate]}
            self._rows[candidate] = candidate.to_json() | row
        return self._known[candidate]

    def moved(self, best: AutoCandidate, allowed: Callable[[AutoCandidate], bool]) -> AutoCandidate:
        """Move the constants of the signals to where the held-out error is least.

        Parameters
        ----------
        best : where to begin
        allowed : whether a candidate could have been offered
        """
        self.error_V(best, best)
        strengths, own = self._strengths[best], set(best.structure(self.dt_s).signals)

        def errors(candidate: AutoCandidate) -> FloatArray | None:
            # The candidate itself was offered; what it is moved to must be such that it could have been.
            if candidate != best and not allowed(candidate):
                return None
            structure = candidate.structure(self.dt_s)
            kept = self._samples.take(structure, ())
            partition = self._boxes_of(structure, kept, candidate.n_models)
            forms = penalties(structure, partition, kept.data, output_coefficients((), self.dt_s))
            self.bank.forget(set(structure.signals) - own)
            return held_out_errors(kept, partition, forms, strengths)

        found = moved(best, errors)
        return found if self.error_V(found, best) < self._known[best] else best

    def begin_again(self) -> None:
        """Forget boxes and errors, which were those of where the search began; the table stays."""
        self._boxes.clear()
        self._known.clear()

    @cached_property
    def _samples(self) -> SampleBank:
        """Samples that candidates are compared on."""
        n_samples = sum(len(run) for run in self.bank.runs)
        return SampleBank(self.bank, max(1, round(n_samples / _SEARCH_SAMPLES)))

    def _boxes_of(self, structure: Structure, kept: KeptSamples, n_models: int) -> Partition:
        """Boxes; candidates that differ in their inputs, poles, sharpness and size alone are compared on the same."""
        key = (tuple((a.signal.partition(":")[0], a.initial, a.splittable) for a in structure.axes), structure.kernel)
        if key not in self._boxes:
            weight = self._samples.keep_every
            source = grow_partitions(structure, kept.inputs, kept.target, kept.data.z, _MOST_MODELS, weight)
            self._boxes[key] = Growing(source)
        return replace(self._boxes[key].of(n_models), k_sigma=np.array([axis.k_sigma for axis in structure.axes]))
