"""A bounded network's coefficients from new runs, held to the old ones by their covariance; terms and knots stay.

The covariance says what the old runs did, so neither they nor sums of them are needed. All bounds hold again: gains are
not negative, and the open-circuit curve rises.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.effects.effect import CURVE
from models.identification.bounded.box_least_squares import solve
from models.identification.bounded.fitted import curve_by_values, theta_of
from models.identification.bounded.knots import Knots
from models.identification.bounded.layout import REFERENCE_DEGC, Layout, slope_limit, soc_over
from models.identification.bounded.monotone import risen
from models.identification.bounded.problem import Sums, make_sums
from models.identification.bounded.terms import Basis, Term
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import VOLTAGE, SignalBank
from models.network.signals import parse_signal
from models.pipeline.refit_problem import Solution
from models.uncertainty.model_uncertainty import Uncertainty, uncertainty_of

# How much what is known of the old runs counts; how alike neighbouring coefficients change, over the new samples.
_OLD_WEIGHTS = (1.0, 0.3, 0.1, 0.03, 0.01, 0.001)
_ALIKE = (1e-2, 1e-4, 1e-3, 1e-1, 1.0)
_UNBOUNDED = "temperature"


@dataclass(frozen=True)
class BoundedSolution:
    """New parameters, how they were held to the old ones, and what is not known of them."""

    solution: Solution
    uncertainty: Uncertainty


def remembers(network: LocalModelNetwork) -> bool:
    """Whether a network is a bounded one that carries what it needs to be held to."""
    family = (network.record.choices or {}).get("family")
    return network.structure.kernel == "hat" and family == "bounded" and network.record.uncertainty is not None


def solved_bounded(
    network: LocalModelNetwork,
    runs: list[GridRun],
    initial_soc: list[float],
    old_weight: float | None,
    freed: Collection[str] = (),
) -> BoundedSolution:
    """Choose both weights on held-out folds of the new runs, and solve.

    Parameters
    ----------
    network : of which `remembers` holds
    runs, initial_soc : new runs on its grid; samples beyond its knots are not learned from
    old_weight : how much the old runs count, in units of what they said; None: chosen
    freed : signals whose gains, or with `CURVE` the curve, the old runs say nothing of; the rest is known as far as it
        is without them

    Raises
    ------
    ModelError
        No sample of the new runs lies between its knots.
    """
    known = uncertainty_of(network)
    assert known is not None and known.parameters.expansion is not None  # of every bounded network
    layout = _layout(network, known)
    problem = _Problem(network, known, layout, _sums(network, layout, runs, initial_soc), freed)
    tried = {w: problem.held_out_V(w, _ALIKE[0]) for w in (_OLD_WEIGHTS if old_weight is None else (old_weight,))}
    weight = min(tried, key=tried.__getitem__)
    alikes = {_ALIKE[0]: tried[weight]} | {a: problem.held_out_V(weight, a) for a in _ALIKE[1:]}
    alike = min(alikes, key=alikes.__getitem__)
    theta, uncertainty = problem.solution(weight, alike, alikes[alike])
    span_V = network.voltage_span_V
    shares = ({key: value / span_V for key, value in each.items()} for each in (tried, alikes))
    return BoundedSolution(Solution(theta, weight, alike, *shares), uncertainty)


def _layout(network: LocalModelNetwork, known: Uncertainty) -> Layout:
    """Where each coefficient of a network stands."""
    expansion, choices = known.parameters.expansion, network.record.choices or {}
    assert expansion is not None
    effects = {term["signal"]: tuple(term["effects"]) for term in choices.get("terms", [])}
    signals = [channel.signal for channel in network.structure.inputs]
    terms = tuple(Term(signal, effects.get(signal, ()), parse_signal(signal).kind != _UNBOUNDED) for signal in signals)
    places = [np.array(each, dtype=np.int64) - 1 for each in expansion.places[:-1]]
    whole = np.array([0, len(expansion.centres) - 3])
    gain, slope = whole, whole
    for term, each in zip(terms, places, strict=True):
        if not term.flat:
            gain, slope = (each, slope) if term.bounded else (gain, each)
    scale = np.array([network.scaling[signal][1] - network.scaling[signal][0] for signal in signals])
    first = np.cumsum([len(expansion.centres) - 2, *(len(each) for each in places)])
    basis = Basis(network.structure.axes[0].signal, terms)
    knots = Knots(expansion.centres[1:-1], gain, slope)
    return Layout(basis, knots, scale, first, slope_limit(knots, _curve_V(network)))


def _sums(network: LocalModelNetwork, layout: Layout, runs: list[GridRun], initial_soc: list[float]) -> Sums:
    """Sums of the new runs; beyond the outermost knots they would bend a curve that only goes on there."""
    low, high = layout.knots.soc[[0, -1]]
    bank = SignalBank(runs, initial_soc, network.cell)
    inside = [(soc >= low) & (soc <= high) for soc in soc_over(bank, layout.basis.axis)]
    kept = [
        replace(run, voltage_V=np.where(known, run.voltage_V, np.nan)) for run, known in zip(runs, inside, strict=True)
    ]
    if all(np.isnan(run.voltage_V).all() for run in kept):
        raise ModelError(
            f"refit: no sample of the new runs lies between SoC {low:.3f} and {high:.3f}, where {network.name} was "
            "trained: fit a new model to old and new runs together"
        )
    return make_sums(SignalBank(kept, initial_soc, network.cell), layout).by_increments()


class _Problem:
    """Sums of the new runs, and what holds the coefficients to the old ones; the curve by its increments."""

    def __init__(
        self, network: LocalModelNetwork, known: Uncertainty, layout: Layout, sums: Sums, freed: Collection[str] = ()
    ) -> None:
        self._network, self._known, self._layout, self._sums = network, known, layout, sums
        n, span_V = layout.n_curve, network.voltage_span_V
        # The network's free parameters have the curve last.
        self._order = np.concatenate([np.arange(n, layout.size), np.arange(n)])
        factor = solve_triangular(known.parameters.factor, np.eye(layout.size), lower=True) / span_V
        precision = np.empty((layout.size, layout.size))
        precision[np.ix_(self._order, self._order)] = factor.T @ factor
        self._by_values = np.eye(layout.size)
        self._by_values[:n, :n] = np.tril(np.ones((n, n)))
        self._noise2 = float(np.mean(known.level_V**2)) * known.correlation.inflation
        self._old = self._noise2 * self._by_values.T @ precision @ self._by_values
        # Directions that neither new nor old runs excite stay where they are.
        self._floor = 1e-6 * np.diag(self._old)
        self._old = _without(self._old, _places(layout, freed))
        self._centre = _coefficients(network, layout)
        self._alike = sums.penalties[0] + sums.penalties[1] + sums.penalties[3]

    def held_out_V(self, weight: float, alike: float) -> float:
        """Error on folds of the new runs that a trial did not see."""
        sums, squared = self._sums, 0.0
        for fold in np.flatnonzero(sums.count):
            kept = np.arange(len(sums.count)) != fold
            if not sums.count[kept].any():
                continue
            matrix, right = self._equations(weight, alike, kept)
            x = solve(matrix, right, self._layout.box).x
            squared += max(float(sums.yy[fold] - 2.0 * x @ sums.xy[fold] + x @ sums.xx[fold] @ x), 0.0)
        return float(np.sqrt(squared / sums.count.sum()))

    def solution(self, weight: float, alike: float, held_out_V: float) -> tuple[FloatArray, Uncertainty]:
        """(M, p) parameters, and what is not known of them."""
        network, known = self._network, self._known
        matrix, right = self._equations(weight, alike, np.ones(len(self._sums.count), dtype=bool))
        found = solve(matrix, right, self._layout.box)
        span_degC = network.record.domain.get("temperature_degC", (REFERENCE_DEGC, REFERENCE_DEGC))
        x = curve_by_values(self._layout, risen(matrix, right, self._layout, found, span_degC))
        whole = matrix * self._sums.count.sum()
        covariance = self._noise2 * self._by_values @ cho_solve(cho_factor(whole), self._by_values.T)
        covariance = covariance[np.ix_(self._order, self._order)] / network.voltage_span_V**2
        ridge = 1e-12 * np.trace(covariance) / len(covariance) * np.eye(len(covariance))
        parameters = replace(known.parameters, factor=np.linalg.cholesky(0.5 * (covariance + covariance.T) + ridge))
        # Where the cell has changed in ways that the terms cannot follow, the bands have to be wider than before.
        wider = max(1.0, held_out_V / float(np.sqrt(np.mean(known.level_V**2))))
        theta = theta_of(self._layout, x, network.scaling[VOLTAGE])
        return theta, replace(known, parameters=parameters, level_V=wider * known.level_V)

    def _equations(self, weight: float, alike: float, kept: np.ndarray) -> tuple[FloatArray, FloatArray]:
        """Matrix and right side of the mean squared error over some of the folds."""
        sums = self._sums
        count = float(sums.count[kept].sum())
        hold = weight * self._old / count + alike * self._alike
        hold[np.diag_indices_from(hold)] += self._floor / count
        return sums.xx[kept].sum(axis=0) / count + hold, sums.xy[kept].sum(axis=0) / count + hold @ self._centre


def _places(layout: Layout, signals: Collection[str]) -> np.ndarray:
    """(P,) whether a coefficient is a gain of one of some signals, or of the curve where that is among them."""
    chosen = np.arange(layout.size) < (layout.n_curve if CURVE in signals else 0)
    for b, term in enumerate(layout.basis.terms):
        chosen[layout.first[b] : layout.first[b + 1]] = term.signal in signals
    return chosen


def _without(precision: FloatArray, freed: np.ndarray) -> FloatArray:
    """(P, P) the same knowledge of the other coefficients, and none of those that are freed."""
    if not freed.any():
        return precision
    kept = np.flatnonzero(~freed)
    among, across = precision[np.ix_(freed, freed)], precision[np.ix_(~freed, freed)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(among), 1e-300))
    scaled = among * np.outer(scale, scale) + 1e-9 * np.eye(len(among))
    out = np.zeros_like(precision)
    out[np.ix_(kept, kept)] = precision[np.ix_(kept, kept)] - (across * scale) @ cho_solve(
        cho_factor(scaled), (across * scale).T
    )
    return 0.5 * (out + out.T)


def _coefficients(network: LocalModelNetwork, layout: Layout) -> FloatArray:
    """(P,) coefficients of a network in V, the curve by its first value and its increments."""
    volts, curve = network.theta * network.voltage_span_V, _curve_V(network)
    gains = [volts[1 + layout.places(b), b] for b in range(len(layout.basis.terms))]
    return np.concatenate([[curve[0]], np.diff(curve), *gains])


def _curve_V(network: LocalModelNetwork) -> FloatArray:
    """(n,) open-circuit curve at 25 degC at its knots."""
    return network.theta[1:-1, -1] * network.voltage_span_V + network.scaling[VOLTAGE][0]
