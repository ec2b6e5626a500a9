"""Fitting the tables and the time constants of a circuit together on the free-run error.

For given time constants (and hysteresis rates) the simulated voltage is linear in all tables: the best tables follow
from one linear solve, and only the few rates are searched (variable projection; Golub and Pereyra, SIAM J. Numer. Anal.
10, 1973). At the best tables the derivative of the error with respect to a rate is the one with the tables held fixed,
which the states' adjoint recursion gives exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from threadpoolctl import threadpool_limits

from models.baselines import smoothness
from models.baselines.circuit_problem import CircuitProblem, Layout
from models.baselines.normal_equations import Term, offsets, solve_bounded
from models.baselines.samples import Samples
from models.baselines.tables import Table
from models.data.errors import NotIdentifiableError
from models.data.timeseries import FloatArray

# Time constants to begin with, as multiples of the sampling time, and hysteresis rates.
_BRANCH_STEPS = (1.0, 2.5, 6.0, 16.0, 40.0, 100.0, 250.0, 600.0, 1500.0)
_GAMMAS = (5.0, 15.0, 40.0, 120.0)
# A log rate that differs by one between neighbouring temperatures must lower the squared error by this share.
_RATE_ROUGHNESS = 1e-3
_MAX_ITERATIONS = 40
# Smallest singular value of the main directions, each scaled to a root mean square of one.
_WEAKEST = 1e-3


@dataclass(frozen=True)
class Fitted:
    """Tables and rates of a circuit.

    Attributes
    ----------
    ocv_V, r0_Ohm : tables
    resistances_Ohm : one table for each branch, the fastest first
    time_constants_s : (n, T) at the layout's temperature knots
    jump_V, hysteresis_V : what the direction and the hysteresis state are multiplied with; None without hysteresis
    gamma : (T,) hysteresis rate; None without hysteresis
    train_rmse_V, held_out_rmse_V : free-run error on the training samples, and on each fold fitted to the others
    log_strengths : of the smoothness
    """

    ocv_V: Table
    r0_Ohm: Table
    resistances_Ohm: tuple[Table, ...]
    time_constants_s: FloatArray
    jump_V: Table | None
    hysteresis_V: Table | None
    gamma: FloatArray | None
    train_rmse_V: float
    held_out_rmse_V: float
    log_strengths: tuple[float, ...]


def fit(samples: Samples, layout: Layout) -> Fitted:
    """Fit a circuit.

    Raises
    ------
    NotIdentifiableError
        Parts of the circuit cannot be told apart in these data; the message names them.
    """
    with threadpool_limits(1, user_api="blas"):
        problem = CircuitProblem(samples, layout)
        theta = _coarse_search(problem)
        _check_told_apart(problem, theta)
        strengths = _smoothing(problem, theta).log_strengths
        for _ in range(2):
            theta = _refined(problem, theta, strengths)
            strengths = _smoothing(problem, theta, strengths).log_strengths
        return _finished(problem, theta, strengths)


def _coarse_search(problem: CircuitProblem) -> FloatArray:
    """(n, T) log rates, equal at all temperatures, with the least held-out error on a grid."""
    layout, bounds = problem.layout, problem.bounds()
    rates = [r for r in -np.log(problem.samples.dt_s * np.array(_BRANCH_STEPS)) if bounds[0, 0] <= r <= bounds[0, 1]]
    if len(rates) < layout.n_branches:
        raise NotIdentifiableError(
            f"runs of at most {problem.samples.longest_s:g} s cannot show {layout.n_branches} time constants. "
            "Record longer runs, or fit fewer branches"
        )
    gammas = [float(g) for g in np.log(_GAMMAS)] if layout.hysteresis else []
    repeat = np.ones(problem.n_temperatures)
    terms = [*problem.fixed, *(problem.branch_term(r * repeat) for r in rates)]
    terms += [problem.hysteresis_term(g * repeat) for g in gammas]
    sums, first = problem.sums(terms, problem.thinned), offsets(terms)
    best, chosen = np.inf, ()
    n_fixed, log_rates = len(problem.fixed), [*rates, *gammas]
    gamma_numbers = [(len(rates) + i,) for i in range(len(gammas))] or [()]
    for branches, gamma in product(combinations(range(len(rates)), layout.n_branches), gamma_numbers):
        numbers = [*range(n_fixed), *(n_fixed + i for i in (*branches, *gamma))]
        columns = np.concatenate([np.arange(first[n], first[n + 1]) for n in numbers])
        error = smoothness.default([terms[n] for n in numbers], sums.chosen(columns)).held_out_mse
        if error < best:
            best, chosen = error, (*branches, *gamma)
    return np.outer([log_rates[i] for i in chosen], repeat)


def _refined(problem: CircuitProblem, theta: FloatArray, strengths: tuple[float, ...]) -> FloatArray:
    """Log rates at the least error; at each temperature of their own as far as the error asks for it."""
    if theta.size == 0:
        return theta
    penalty = smoothness.weighted(smoothness.forms(problem.terms(theta)), strengths)
    scale, _ = problem.cost_and_gradient(theta, penalty)

    def objective(flat: FloatArray) -> tuple[float, FloatArray]:
        rates = flat.reshape(theta.shape)
        cost, gradient = problem.cost_and_gradient(rates, penalty)
        change = np.diff(rates, axis=1)
        gradient = gradient / scale
        gradient[:, 1:] += 2.0 * _RATE_ROUGHNESS * change
        gradient[:, :-1] -= 2.0 * _RATE_ROUGHNESS * change
        return cost / scale + _RATE_ROUGHNESS * float((change**2).sum()), gradient.ravel()

    bounds = np.repeat(problem.bounds(), theta.shape[1], axis=0)
    start = np.clip(theta.ravel(), bounds[:, 0], bounds[:, 1])
    # Lazy: 0.5 s of processor time.
    from scipy.optimize import minimize

    found = minimize(
        objective,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": _MAX_ITERATIONS, "ftol": 1e-7},
    )
    return found.x.reshape(theta.shape)


def _smoothing(
    problem: CircuitProblem, theta: FloatArray, start: tuple[float, ...] | None = None
) -> smoothness.Smoothing:
    terms = problem.terms(theta)
    return smoothness.choose(smoothness.forms(terms), problem.sums(terms, problem.thinned), start)


def _finished(problem: CircuitProblem, theta: FloatArray, strengths: tuple[float, ...]) -> Fitted:
    """Tables from all samples, with resistances that are not negative and an open-circuit voltage that rises."""
    n, hysteresis = problem.layout.n_branches, problem.layout.hysteresis
    order = np.argsort(-theta[:n].mean(axis=1))
    theta = np.concatenate([theta[:n][order], theta[n:]])
    terms = problem.terms(theta)
    sums = problem.sums(terms, problem.samples.fold)
    penalty = smoothness.weighted(smoothness.forms(terms), strengths)
    information = sums.xx.sum(axis=0) + sums.count.sum() * penalty
    x = _physical(terms, information, sums.xy.sum(axis=0))
    tables = problem.tables(terms, x)
    known = problem.samples.fold >= 0
    error = (problem.simulated_V(terms, x) - problem.samples.voltage_V)[known]
    first = len(problem.fixed)
    return Fitted(
        ocv_V=tables[0],
        r0_Ohm=tables[1],
        resistances_Ohm=tuple(tables[first : first + n]),
        time_constants_s=np.exp(-theta[:n]),
        jump_V=tables[2] if hysteresis else None,
        hysteresis_V=tables[-1] if hysteresis else None,
        gamma=np.exp(theta[-1]) if hysteresis else None,
        train_rmse_V=float(np.sqrt(np.mean(error**2))),
        held_out_rmse_V=float(np.sqrt(smoothness.held_out_mse(sums, penalty))),
        log_strengths=strengths,
    )


def _physical(terms: list[Term], information: FloatArray, right: FloatArray) -> FloatArray:
    """Best tables in which nothing is negative and the open-circuit voltage does not fall with charge."""
    n_soc, n_temperature = terms[0].soc.size, terms[0].temperature.size
    # The curve as a sum of its rises, each of which must not be negative; its lowest value is free.
    to_values = np.eye(len(right))
    size = n_soc * n_temperature
    to_values[:size, :size] = np.kron(np.tril(np.ones((n_soc, n_soc))), np.eye(n_temperature))
    bounded = np.arange(len(right)) >= n_temperature
    rises = solve_bounded(to_values.T @ information @ to_values, to_values.T @ right, bounded)
    return to_values @ rises


def _check_told_apart(problem: CircuitProblem, theta: FloatArray) -> None:
    """Refuse data in which the parts of the circuit make the same voltage."""
    terms = problem.terms(theta)
    kept = problem.thinned >= 0
    time_constants_s = np.exp(-theta[: problem.layout.n_branches].mean(axis=1))
    names = ["the open-circuit voltage", "the slope of the open-circuit curve", "the series resistance"]
    names += ["the jump of the voltage with the direction"] * problem.layout.hysteresis
    names += [f"the resistance with {tau:.3g} s" for tau in time_constants_s]
    names += ["the hysteresis"] * problem.layout.hysteresis
    soc = problem.samples.soc
    columns = np.stack([terms[0].signal, soc - soc[kept].mean(), *(term.signal for term in terms[1:])], axis=1)[kept]
    rms = np.sqrt(np.mean(columns**2, axis=0))
    if (rms == 0.0).any():
        raise NotIdentifiableError(f"{names[int(np.argmin(rms))]} has no effect in these data. Record pulses and rests")
    _, singular, directions = np.linalg.svd(columns / rms, full_matrices=False)
    if singular[-1] < _WEAKEST * np.sqrt(len(columns)):
        weak = np.argsort(-np.abs(directions[-1]))[:2]
        raise NotIdentifiableError(
            f"{names[weak[0]]} and {names[weak[1]]} cannot be told apart in these data: they make the same voltage. "
            "Record pulses of several sizes in both directions, with rests between them"
        )
