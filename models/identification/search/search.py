"""Choosing orders, time constants, sharpness, regularisation and size from the training data alone.

Each candidate is constructed, fitted with shared poles and judged by its free-run error on held-out samples. The
choices are made one after the other, each with the best of those before; the table of all candidates is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from models.data.metrics import noise_floor_V
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.identification.lolimot import grow_partitions
from models.identification.search.auto import AutoCandidate, alternatives, find_offer, first_candidate, stands_apart
from models.identification.search.circuit_start import circuit_alternatives, circuit_starts
from models.identification.search.given import GivenCandidate, pole_alternatives, poles_for, size_alternatives
from models.identification.search.moved_constants import held_out_errors, moved
from models.identification.search.samples import KeptSamples, SampleBank
from models.identification.shared_poles import (
    Moments,
    SharedPoleFit,
    compare,
    filtered,
    fit,
    moments,
    output_coefficients,
    penalties,
)
from models.network.partition import Partition
from models.network.regression import VOLTAGE, CellContext, Dataset, Scaling, SignalBank, build_dataset, find_scaling
from models.network.structure import Structure, full_structure, minimal_structure

Progress = Callable[[float, str], None]

_RELAXATION_S = (100.0, 300.0, 600.0, 1000.0, 3000.0)
_POLES_S = (4.0, 10.0, 25.0, 60.0)
_CURRENT_ORDERS = (1, 2, 3)
_SOC_K_SIGMA = (0.35, 0.5, 0.7, 1.0)
_TEMPERATURE_K_SIGMA = (0.45, 0.6, 0.85, 1.2, 2.0)
_SIZES = (6, 12, 18, 24, 30, 36)
_FINER = (0.5, 0.7, 1.4, 2.0)
# The fastest pole that a sampling time can show, in samples.
_FASTEST_SAMPLES = 2.0
# A change must lower the held-out error by this share to be made.
_WORTH = 0.005
# Held-out errors that differ by less than this share are alike: errors hang together over hundreds of samples.
_ALIKE = 0.04
# Nothing simulates better than the measurement's noise. A held-out error of that many times the noise is at it: its
# parameters cost a few percent on the samples of the search, and the noise is not known better.
_AT_THE_NOISE = 1.1
# Samples in the sums while candidates are compared.
_SEARCH_SAMPLES = 6_000
# More local models than any candidate asks for.
_MOST_MODELS = 1000
# Samples in the sums of the final fit where there are no past outputs; more of them tell nothing new.
_STATIC_SAMPLES = 400_000


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
    n_models : number of local models asked for
    """

    family: str
    poles_s: tuple[float, ...] = (25.0,)
    current_order: int = 2
    relaxation_s: float = 600.0
    soc_k_sigma: float = 0.7
    temperature_k_sigma: float = 1.2
    n_models: int = 12

    def structure(self, dt_s: float) -> Structure:
        """Build the structure that these choices stand for."""
        order = len(self.poles_s)
        if self.family == "minimal":
            return minimal_structure(dt_s, order, self.current_order, self.soc_k_sigma)
        return full_structure(
            dt_s, order, self.current_order, self.relaxation_s, self.soc_k_sigma, self.temperature_k_sigma
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


@dataclass(frozen=True)
class Fitted:
    """A candidate with its parameters: everything that refinement and document need."""

    structure: Structure
    scaling: Scaling
    data: Dataset
    partition: Partition
    a: FloatArray
    sums: Moments
    fit: SharedPoleFit

    @property
    def theta(self) -> FloatArray:
        """(M, p) parameters with the shared poles in each local model."""
        return full_theta(self.a, self.fit.b, self.partition.n_models)

    @property
    def held_out_rmse_V(self) -> float:
        """Free-run RMSE on held-out samples in V."""
        return float(np.sqrt(self.fit.held_out_mse)) * span_V(self.scaling)


@dataclass
class _Growing:
    """Ever larger partitions, each the one before with one box split; made as far as they are asked for."""

    source: Iterator[Partition]
    made: list[Partition] = field(default_factory=list)

    def of(self, n_models: int) -> Partition:
        """Return the partition with as many boxes, or the largest that the data allow."""
        while not self.made or self.made[-1].n_models < n_models:
            larger = next(self.source, None)
            if larger is None:
                break
            self.made.append(larger)
        fitting = [partition for partition in self.made if partition.n_models <= n_models]
        return fitting[-1] if fitting else self.made[0]


@dataclass
class Search:
    """The search over candidates on one set of training runs."""

    runs: list[GridRun]
    initial_soc: list[float]
    cell: CellContext
    progress: Progress
    _rows: dict[Choice, dict[str, Any]] = field(default_factory=dict)
    _known: dict[Choice, float] = field(default_factory=dict)
    _boxes: dict[tuple[object, ...], _Growing] = field(default_factory=dict)
    _strengths: dict[Choice, tuple[float, ...]] = field(default_factory=dict)
    _apart: dict[tuple[object, ...], bool] = field(default_factory=dict)

    @cached_property
    def bank(self) -> SignalBank:
        """Signals of the runs, shared by all candidates."""
        return SignalBank(self.runs, self.initial_soc, self.cell)

    @cached_property
    def _samples(self) -> SampleBank:
        """Samples that candidates are compared on."""
        n_samples = sum(len(run) for run in self.runs)
        return SampleBank(self.bank, max(1, round(n_samples / _SEARCH_SAMPLES)))

    @property
    def table(self) -> list[dict[str, Any]]:
        """What was tried, with its held-out error."""
        return list(self._rows.values())

    @property
    def dt_s(self) -> float:
        """Sampling time of the runs' grid in s."""
        return self.runs[0].dt_s

    def best(self, family: str) -> Choice:
        """Choose one thing after the other, twice, and return the best candidate."""
        with threadpool_limits(1, user_api="blas"):
            if family == "auto":
                return self._best_auto()
            best = Candidate(family, poles_s=(self._slow_enough(25.0),))
            slow = sorted({self._slow_enough(pole) for pole in _POLES_S})
            relaxations = _RELAXATION_S if family == "full" else (best.relaxation_s,)
            # A curve that few local models do not resolve would be mistaken for slow relaxation.
            best = self._choose(best, [replace(best, n_models=size) for size in _SIZES], 0.0)
            best = self._choose(
                best, [replace(best, relaxation_s=r, poles_s=(p,)) for r in relaxations for p in slow], 0.0
            )
            best = self._pass(best, 0.2)
            # The boxes were those of where the search began.
            self._boxes.clear()
            self._known.clear()
            return self._pass(best, 0.6)

    def best_within(self, given: Structure) -> GivenCandidate:
        """Choose poles and size for a structure that is given."""
        fastest_s = _FASTEST_SAMPLES * self.dt_s
        best = GivenCandidate(given, poles_for(given.output_order, 25.0, fastest_s))
        with threadpool_limits(1, user_api="blas"):
            for done in (0.0, 0.5):
                best = self._choose(best, pole_alternatives(best, fastest_s), done)
                best = self._choose(best, size_alternatives(best), done + 0.25)
        return best

    def _best_auto(self) -> AutoCandidate:
        offer = find_offer(self.bank)
        circuit = self._circuit(offer.warm)
        if circuit is not None and self._known[circuit] < _AT_THE_NOISE * self._noise_floor_V():
            return circuit
        best = first_candidate(self.cell.capacity_Ah, offer)
        for done in (0.1, 0.55):
            before, stage = best, 0
            while tried := alternatives(best, offer, stage):
                best = self._choose(best, tried, done + 0.02 * stage)
                stage += 1
            best = self._moved(best, done + 0.4)
            if best == before:
                break
        # Of two that simulate alike the circuit, whose few constants were moved until they fit.
        if circuit is not None and self._known[circuit] < (1.0 + _ALIKE) * self._known[best]:
            return circuit
        return best

    def _circuit(self, warm: bool) -> AutoCandidate | None:
        """Search from an equivalent circuit's terms; None where the runs cannot tell them."""
        starts = [each for each in circuit_starts(self.cell.capacity_Ah, warm) if self._stands_apart(each)]
        if not starts:
            return None
        circuit, stage = min((self._moved(each, 0.02) for each in starts), key=self._known.__getitem__), 0
        while (tried := circuit_alternatives(circuit, warm, stage)) is not None:
            self.progress(0.04 + 0.01 * stage, f"trying {circuit}")
            # No change is too small: constants are moved, not terms added.
            apart = [each for each in tried if self._stands_apart(each)]
            errors = {each: self._held_out_error(each, circuit) for each in dict.fromkeys([circuit, *apart])}
            chosen = min(errors, key=errors.__getitem__)
            circuit, stage = self._moved(chosen, 0.05) if chosen != circuit else circuit, stage + 1
        return circuit

    def _noise_floor_V(self) -> float:
        """Median over the runs; 0 where no run is steady for long enough to show it."""
        floors = np.array([noise_floor_V(run.voltage_V, run.current_A) for run in self.runs])
        return float(np.median(floors[np.isfinite(floors)])) if np.isfinite(floors).any() else 0.0

    def _moved(self, best: AutoCandidate, share_done: float) -> AutoCandidate:
        """Move the constants of the signals to where the held-out error is least."""
        self.progress(share_done, f"moving the constants of {best}")
        self._held_out_error(best, best)
        strengths, own = self._strengths[best], set(best.structure(self.dt_s).signals)

        def errors(candidate: AutoCandidate) -> FloatArray | None:
            # The candidate itself was offered; what it is moved to must be such that it could have been.
            if candidate != best and not self._stands_apart(candidate):
                return None
            structure = candidate.structure(self.dt_s)
            kept = self._samples.take(structure, ())
            partition = self._boxes_of(structure, kept, candidate.n_models)
            forms = penalties(structure, partition, kept.data, output_coefficients((), self.dt_s))
            self.bank.forget(set(structure.signals) - own)
            return held_out_errors(kept, partition, forms, strengths)

        found = moved(best, errors)
        return found if self._held_out_error(found, best) < self._known[best] else best

    def _stands_apart(self, candidate: AutoCandidate) -> bool:
        key = (max(candidate.time_constants_s), candidate.hysteresis_rates)
        if key not in self._apart:
            self._apart[key] = stands_apart(candidate, self.bank)
        return self._apart[key]

    def _pass(self, best: Candidate, done: float) -> Candidate:
        full = best.family == "full"
        slow = sorted({self._slow_enough(pole) for pole in _POLES_S})
        best = self._choose(best, [replace(best, n_models=size) for size in _SIZES], done + 0.2)
        if full:
            best = self._choose(best, [replace(best, relaxation_s=r) for r in _RELAXATION_S], done + 0.22)
        best = self._choose(best, [replace(best, poles_s=(*best.poles_s[:-1], pole)) for pole in slow], done + 0.24)
        best = self._choose(best, [replace(best, current_order=m) for m in _CURRENT_ORDERS], done + 0.25)
        fast = self._slow_enough(best.poles_s[-1] / 8.0)
        if fast < 0.5 * best.poles_s[-1]:
            two = [replace(best, poles_s=(fast, best.poles_s[-1]), current_order=m) for m in _CURRENT_ORDERS[1:]]
            best = self._choose(best, two, done + 0.28)
        best = self._choose(best, [replace(best, soc_k_sigma=k) for k in _SOC_K_SIGMA], done + 0.3)
        if full:
            best = self._choose(best, [replace(best, temperature_k_sigma=k) for k in _TEMPERATURE_K_SIGMA], done + 0.33)
            best = self._choose(best, [replace(best, relaxation_s=f * best.relaxation_s) for f in _FINER], done + 0.36)
        slower = [replace(best, poles_s=(*best.poles_s[:-1], self._slow_enough(f * best.poles_s[-1]))) for f in _FINER]
        return self._choose(best, slower, done + 0.38)

    def fitted(self, candidate: Choice) -> Fitted:
        """Construct and fit a candidate with its poles shared, on all samples."""
        structure, n_samples = candidate.structure(self.dt_s), sum(len(run) for run in self.runs)
        # Without past outputs a sample stands for itself, and those that do not count need not be made.
        keep_every = 1 if candidate.poles_s else max(1, n_samples // _STATIC_SAMPLES)
        scaling = find_scaling(structure, self.runs, self.initial_soc, self.cell, self.bank)
        data = build_dataset(structure, scaling, self.runs, self.initial_soc, self.cell, self.bank, keep_every)
        a = output_coefficients(candidate.poles_s, self.dt_s)
        with threadpool_limits(1, user_api="blas"):
            inputs, target = filtered(data, a)
            *_, partition = grow_partitions(structure, inputs, target, data.z, candidate.n_models, keep_every)
            sums = moments(partition, data, a, data.groups())
            chosen = fit(sums, penalties(structure, partition, data, a), self._strengths.get(candidate))
        return Fitted(structure, scaling, data, partition, a, sums, chosen)

    def _boxes_of(self, structure: Structure, kept: KeptSamples, n_models: int) -> Partition:
        """Boxes; candidates that differ in their inputs, poles, sharpness and size alone are compared on the same."""
        key = (tuple((a.signal.partition(":")[0], a.initial, a.splittable) for a in structure.axes), structure.kernel)
        if key not in self._boxes:
            weight = self._samples.keep_every
            source = grow_partitions(structure, kept.inputs, kept.target, kept.data.z, _MOST_MODELS, weight)
            self._boxes[key] = _Growing(source)
        return replace(self._boxes[key].of(n_models), k_sigma=np.array([axis.k_sigma for axis in structure.axes]))

    def _choose(self, current: ChoiceT, candidates: list[ChoiceT], share_done: float) -> ChoiceT:
        """Return the best; the present choice stays unless another is worth the change."""
        errors = {}
        for candidate in dict.fromkeys([current, *candidates]):
            self.progress(share_done, f"trying {candidate}")
            errors[candidate] = self._held_out_error(candidate, current)
        best = min(errors, key=errors.__getitem__)
        return best if errors[best] < errors[current] * (1.0 - _WORTH) else current

    def _held_out_error(self, candidate: Choice, current: Choice) -> float:
        """Free-run RMSE in V on held-out samples, of a fit to fewer samples."""
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

    def _slow_enough(self, time_constant_s: float) -> float:
        return max(time_constant_s, _FASTEST_SAMPLES * self.dt_s)


def full_theta(a: FloatArray, b: FloatArray, n_models: int) -> FloatArray:
    """(M, p) parameters from shared output coefficients and stacked input parameters."""
    return np.hstack([np.tile(a, (n_models, 1)), b.reshape(n_models, -1)])


def span_V(scaling: Scaling) -> float:
    """Volts per unit of normalised output."""
    return scaling[VOLTAGE][1] - scaling[VOLTAGE][0]
