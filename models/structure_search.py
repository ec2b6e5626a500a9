"""Choosing orders, time constants, sharpness, regularisation and size from the training data alone.

Each candidate is constructed and refined without the held-out samples and judged by its free-run error on them. The
choices are made one after the other, each with the best of those before; the table of all candidates is kept.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from models.holdout import folds
from models.local_model_network import free_run
from models.lolimot import construct
from models.output_error import Penalty, refine
from models.regression import CellContext, Scaling, build_dataset, find_scaling
from models.resampling import GridRun
from models.structure import Structure, full_structure, minimal_structure

Progress = Callable[[float, str], None]

_RELAXATION_S = (30.0, 100.0, 300.0, 1000.0, 3000.0)
_ORDERS = ((1, 1), (1, 2), (2, 2))
_SOC_K_SIGMA = (0.35, 0.5, 0.75)
_TEMPERATURE_K_SIGMA = (0.45, 0.6, 0.85)
_NEIGHBOURS = (1e-8, 1e-7, 1e-6, 1e-5, 1e-4)
_SIZES = (6, 12, 18, 24, 30)
_SEARCH_SIZE = 18
# Steps of the refinement while inputs and sharpness are compared, and while sizes and regularisation are: a large
# network needs more steps to show what it can do.
_SEARCH_ITERATIONS = 6
_SIZE_ITERATIONS = 15
# A larger network must lower the held-out error by this share to be preferred.
_WORTH = 0.01


@dataclass(frozen=True)
class Candidate:
    """One set of choices.

    Attributes
    ----------
    family : "full" or "minimal"
    n_models : number of local models asked for
    towards_neighbours : regularisation of the refinement
    iterations : steps of the refinement while the candidate is judged
    """

    family: str
    output_order: int = 1
    current_order: int = 1
    relaxation_s: float = 600.0
    soc_k_sigma: float = 0.5
    temperature_k_sigma: float = 0.6
    towards_neighbours: float = 1e-6
    n_models: int = _SEARCH_SIZE
    iterations: int = _SEARCH_ITERATIONS

    def structure(self, dt_s: float) -> Structure:
        """Build the structure that these choices stand for."""
        if self.family == "minimal":
            return minimal_structure(dt_s, self.output_order, self.current_order, self.soc_k_sigma)
        return full_structure(
            dt_s, self.output_order, self.current_order, self.relaxation_s, self.soc_k_sigma, self.temperature_k_sigma
        )

    @property
    def penalty(self) -> Penalty:
        """Regularisation of the refinement."""
        return Penalty(towards_start=1e-6, towards_neighbours=self.towards_neighbours)


@dataclass
class Search:
    """The search over candidates on one set of training runs."""

    runs: list[GridRun]
    initial_soc: list[float]
    cell: CellContext
    progress: Progress
    table: list[dict[str, Any]] = field(default_factory=list)
    _known: dict[Candidate, float] = field(default_factory=dict)

    def best(self, family: str) -> Candidate:
        """Choose one thing after the other and return the best candidate."""
        best = Candidate(family)
        if family == "full":
            best = self._choose(best, [replace(best, relaxation_s=tau) for tau in _RELAXATION_S], 0.0)
        best = self._choose(best, [replace(best, output_order=n, current_order=m) for n, m in _ORDERS], 0.3)
        best = self._choose(best, [replace(best, soc_k_sigma=k) for k in _SOC_K_SIGMA], 0.5)
        if family == "full":
            best = self._choose(best, [replace(best, temperature_k_sigma=k) for k in _TEMPERATURE_K_SIGMA], 0.6)
        best = replace(best, iterations=_SIZE_ITERATIONS)
        best = self._choose(best, [replace(best, n_models=size) for size in _SIZES], 0.7)
        return self._choose(best, [replace(best, towards_neighbours=s) for s in _NEIGHBOURS], 0.85)

    def _choose(self, current: Candidate, candidates: list[Candidate], share_done: float) -> Candidate:
        """Return the best; of those within the worth of a change, the first."""
        errors = []
        for candidate in candidates:
            self.progress(share_done, f"trying {candidate.structure(self.runs[0].dt_s).name} {_short(candidate)}")
            errors.append(self.held_out_error(candidate))
        limit = min(errors) * (1.0 + _WORTH)
        if current in self._known and self._known[current] <= limit and current not in candidates:
            return current
        return next(c for c, e in zip(candidates, errors, strict=True) if e <= limit)

    def held_out_error(self, candidate: Candidate) -> float:
        """Free-run RMSE in V on held-out samples; infinite where the candidate cannot be built."""
        if candidate in self._known:
            return self._known[candidate]
        structure = candidate.structure(self.runs[0].dt_s)
        scaling = find_scaling(structure, self.runs, self.initial_soc, self.cell)
        squares, count, sizes = 0.0, 0, []
        data = build_dataset(structure, scaling, self.runs, self.initial_soc, self.cell)
        for held in folds(data):
            *_, local = construct(structure, data, candidate.n_models, use=~held)
            refined = refine(
                local.theta,
                structure.output_order,
                local.partition,
                data,
                candidate.penalty,
                weights=(~held).astype(np.float64),
                max_iterations=candidate.iterations,
            )
            simulated = free_run(refined.theta, structure.output_order, local.partition.validity(data.z), data)
            error = (simulated - data.y)[held & ~np.isnan(data.y)]
            squares += float(error @ error)
            count += len(error)
            sizes.append(local.partition.n_models)
        rmse_V = float(np.sqrt(squares / max(count, 1))) * span_V(scaling)
        rmse_V = rmse_V if np.isfinite(rmse_V) else float("inf")
        self._known[candidate] = rmse_V
        self.table.append({**_plain(candidate), "n_models_built": max(sizes), "held_out_rmse_mV": 1e3 * rmse_V})
        return rmse_V


def span_V(scaling: Scaling) -> float:
    """Volts per unit of normalised output."""
    return scaling["voltage"][1] - scaling["voltage"][0]


def _plain(candidate: Candidate) -> dict[str, Any]:
    return {key: getattr(candidate, key) for key in candidate.__dataclass_fields__}


def _short(candidate: Candidate) -> str:
    return (
        f"n={candidate.output_order} m={candidate.current_order} tau={candidate.relaxation_s:g} s "
        f"M={candidate.n_models}"
    )
