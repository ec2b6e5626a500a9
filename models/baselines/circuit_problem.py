"""The free run of a circuit as terms: what is linear in the tables, and what the rates of its states change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.baselines.normal_equations import Sums, Term, accumulate, offsets, solve
from models.baselines.recursions import branch_drive, direction, hysteresis_drive, log_rate_gradient, state
from models.baselines.samples import Samples
from models.baselines.tables import Table, locate
from models.data.timeseries import FloatArray

# A branch slower than this share of the longest run looks like a part of the open-circuit curve.
_SLOWEST_SHARE = 0.3
# The fastest branch that a sampling time can show, in samples.
_FASTEST_STEPS = 0.5
_GAMMA_BOUNDS = (1.0, 500.0)
# Samples in the sums while rates are searched; all samples pass through the states.
_SEARCH_SAMPLES = 40_000


@dataclass(frozen=True)
class Layout:
    """Which tables a circuit has.

    Attributes
    ----------
    ocv_soc, ocv_degC : knots of the open-circuit voltage
    resistance_soc : knots of the resistances
    temperature_degC : knots of resistances, rates and hysteresis
    n_branches : resistors beside a capacitor
    hysteresis : whether there is a hysteresis state, and a jump with the direction
    """

    ocv_soc: FloatArray
    ocv_degC: FloatArray
    resistance_soc: FloatArray
    temperature_degC: FloatArray
    n_branches: int
    hysteresis: bool


class CircuitProblem:
    """Terms, sums and errors of one circuit over its training samples.

    The terms come in this order: open-circuit voltage, series resistance, jump with the direction (with hysteresis),
    branches, hysteresis state. `theta` (n, T) are the log rates of the branches and the hysteresis.
    """

    def __init__(self, samples: Samples, layout: Layout) -> None:
        self.samples, self.layout = samples, layout
        thin = max(1, int((samples.fold >= 0).sum()) // _SEARCH_SAMPLES)
        self.thinned = np.where(np.arange(len(samples.fold)) % thin == 0, samples.fold, -1)
        self._y = np.nan_to_num(samples.voltage_V)
        self._temperature = locate(layout.temperature_degC, samples.temperature_degC)
        self._soc = locate(layout.resistance_soc, samples.soc)
        self._everywhere = locate(np.array([0.5]), samples.soc)
        ocv = locate(layout.ocv_soc, samples.soc), locate(layout.ocv_degC, samples.temperature_degC)
        self.fixed = [
            Term(np.ones(len(self._y)), *ocv, is_ocv=True),
            Term(samples.current_A, self._soc, self._temperature),
        ]
        self._branch = branch_drive(samples.current_A, samples.dt_s, samples.starts)
        self._drives = [self._branch] * layout.n_branches
        if layout.hysteresis:
            cell, starts = samples.cell, samples.run_starts
            sign = direction(samples.current_A, cell.rest_A, starts)
            self.fixed.append(Term(sign, self._everywhere, self._temperature))
            self._drives.append(
                hysteresis_drive(samples.current_A, samples.dt_s, cell.capacity_Ah, cell.rest_A, starts)
            )

    @property
    def n_temperatures(self) -> int:
        """Temperature knots of the rates."""
        return self._temperature.size

    def branch_term(self, log_rate: FloatArray) -> Term:
        """Term of a branch."""
        return Term(state(self._branch, log_rate, self._temperature), self._soc, self._temperature)

    def hysteresis_term(self, log_rate: FloatArray) -> Term:
        """Term of the hysteresis state."""
        return Term(state(self._drives[-1], log_rate, self._temperature), self._everywhere, self._temperature)

    def terms(self, theta: FloatArray) -> list[Term]:
        """All terms."""
        n = self.layout.n_branches
        branches = [self.branch_term(row) for row in theta[:n]]
        return [*self.fixed, *branches, *(self.hysteresis_term(row) for row in theta[n:])]

    def sums(self, terms: list[Term], fold: np.ndarray) -> Sums:
        """Products of the terms' columns over the samples whose `fold` is not -1."""
        return accumulate(terms, self._y, fold, self.samples.n_folds)

    def bounds(self) -> FloatArray:
        """(n, 2) range of each log rate."""
        dt_s = self.samples.dt_s
        slowest_s = max(_SLOWEST_SHARE * self.samples.longest_s, 4.0 * _FASTEST_STEPS * dt_s)
        branch = [-np.log(slowest_s), -np.log(_FASTEST_STEPS * dt_s)]
        gamma = [list(np.log(_GAMMA_BOUNDS))] if self.layout.hysteresis else []
        return np.array([branch] * self.layout.n_branches + gamma)

    def tables(self, terms: list[Term], x: FloatArray) -> list[Table]:
        """Cut a solution into the terms' tables."""
        parts = np.split(x, offsets(terms)[1:-1])
        return [
            Table(term.soc.knots, term.temperature.knots, part.reshape(term.soc.size, term.temperature.size))
            for term, part in zip(terms, parts, strict=True)
        ]

    def simulated_V(self, terms: list[Term], x: FloatArray) -> FloatArray:
        """(N,) free run."""
        tables = self.tables(terms, x)
        return np.sum([term.signal * values for term, values in zip(terms, self._values(tables), strict=True)], axis=0)

    def cost_and_gradient(self, theta: FloatArray, penalty: FloatArray) -> tuple[float, FloatArray]:
        """Mean squared error with smoothness in V^2 at the best tables, and its derivative (n, T)."""
        terms = self.terms(theta)
        sums = self.sums(terms, self.thinned)
        count = float(sums.count.sum())
        right = sums.xy.sum(axis=0)
        x = solve(sums.xx.sum(axis=0) + count * penalty, right)
        cost = float(sums.yy.sum() - x @ right) / count
        values = self._values(self.tables(terms, x))
        simulated = np.sum([term.signal * value for term, value in zip(terms, values, strict=True)], axis=0)
        error = np.where(self.thinned >= 0, self._y - simulated, 0.0)
        gradient = np.empty_like(theta)
        states = terms[len(self.fixed) :]
        for i, (drive, term, value) in enumerate(zip(self._drives, states, values[len(self.fixed) :], strict=True)):
            weight = -2.0 / count * error * value
            gradient[i] = log_rate_gradient(drive, theta[i], self._temperature, term.signal, weight)
        return cost, gradient

    def _values(self, tables: list[Table]) -> list[FloatArray]:
        return [table.at(self.samples.soc, self.samples.temperature_degC) for table in tables]
