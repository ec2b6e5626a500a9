"""How far a known cell is off at other operating points and times: a random process, learned where it did not see.

A model's error in one place says something of that in places like it: at nearby states of charge and temperatures,
under currents of a like history. What it left of the training runs is known there, and taken off; what remains grows
with the distance from them (Kennedy and O'Hagan, J. R. Statist. Soc. B 63, 2001). Errors hang together in time, too.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, get_lapack_funcs

from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import SURFACE
from models.diagnosis.known.thresholds import KNOWN, Known
from models.effects.view import View
from models.network.signals import arrhenius
from models.network.signals.filters import low_pass

_SMALL_SOC = 5e-3
(_POTRI,) = get_lapack_funcs(("potri",), (np.zeros(0),))


@dataclass(frozen=True)
class Points:
    """Operating points.

    Attributes
    ----------
    run, time_s : (m,) number of the run and time in it
    soc, temperature_degC : (m,) that of the particles' surface, where the model has one
    rates : (m, b) currents over the capacity, low-passed and scaled by temperature, 1/h
    slope_V : (m,) of the open-circuit curve at the mean SoC, per SoC of 1; at the surface's a measured cell's grown
        resistance (B0047, 4 degC) is no more told from errors that go with the load there
    away : (m,) how far beyond the training runs, in units in which the error is expected to double
    """

    run: FloatArray
    time_s: FloatArray
    soc: FloatArray
    temperature_degC: FloatArray
    rates: FloatArray
    slope_V: FloatArray
    away: FloatArray

    @classmethod
    def joined(cls, parts: list[Points]) -> Points:
        """Points of several runs."""
        return cls(*(np.concatenate([getattr(p, each.name) for p in parts]) for each in fields(cls)))


def points_of(view: View, number: int, domain: dict[str, tuple[float, float]], at: Known = KNOWN) -> Points:
    """Operating points of a run's samples.

    Parameters
    ----------
    view : run and samples
    number : of the run
    domain : ranges of the training runs
    """
    run, index = view.run, view.index
    degC = np.where(np.isnan(run.temperature_degC), 25.0, run.temperature_degC)
    scaled = run.current_A * arrhenius(degC, at.rate_activation_K) / view.capacity_Ah
    rates = [scaled, *(low_pass(scaled, tau_s, run.dt_s) for tau_s in at.rate_s)]
    mean, model = view.soc[index], view.model
    # What a model has over the state of charge it has over that of the surface.
    soc = mean + view.inputs.surface
    slope = (model.open_circuit_V(mean + _SMALL_SOC) - model.open_circuit_V(mean - _SMALL_SOC)) / (2.0 * _SMALL_SOC)
    low, high = domain.get("temperature_degC", (-np.inf, np.inf))
    away = np.maximum(np.maximum(low - degC, degC - high), 0.0) / at.away_K
    low, high = domain["current_A"]
    away = away + np.maximum(np.maximum(low - run.current_A, run.current_A - high), 0.0) / max(high - low, 1e-9)
    low, high = domain.get(SURFACE, domain["soc"])
    beyond = np.maximum(np.maximum(low - soc, soc - high), 0.0) / at.away_soc
    return Points(
        np.full(len(index), float(number)),
        run.time_s[index],
        soc,
        degC[index],
        np.column_stack([each[index] for each in rates]),
        slope,
        away[index] + beyond,
    )


@dataclass(frozen=True)
class Elsewhere:
    """The process with its variances, and what is known of it at points of the training runs.

    Attributes
    ----------
    variances : of the causes, in the order of `PLACES`, `TIMES` and `WHITE`
    granted : of each effect's size from run to run, by its name, in units of the usual size
    rate_scale : (b,) root mean square of the rates in the training runs
    known : points of the training runs
    left_V, unseen_V : (m,) error there, as fitted, and by fits that did not see them
    noise_V2, own_V2 : variances on top, of noise and of errors of minutes, that these points do not show
    """

    variances: FloatArray
    granted: dict[str, float]
    rate_scale: FloatArray
    known: Points
    left_V: FloatArray
    unseen_V: FloatArray
    noise_V2: float = 0.0
    own_V2: float = 0.0

    @property
    def white_share(self) -> float:
        """Share of the squared error on unseen runs that hangs together with nothing: noise, no error of the model."""
        usual_V2 = float(np.mean(self.unseen_V**2))
        white_V2 = self.variances[len(PLACES) + len(TIMES)] * usual_V2 + self.noise_V2
        return float(white_V2 / (self.variances.sum() * usual_V2 + self.noise_V2 + self.own_V2))

    def conditional(self, points: Points) -> tuple[FloatArray, FloatArray]:
        """Mean (n,) in V and (n, n) covariance in V^2 of the process over operating points, given what is known."""
        own = self._level(points)
        across = self._places(points, self.known) * np.outer(own, self._known_level)
        solved = cho_solve(self._factor, across.T)
        return across @ self._weights, self._places(points, points) * np.outer(own, own) - across @ solved

    def in_time(self, points: Points) -> FloatArray:
        """(n, n) covariance in V^2 of what hangs together in time only, and of what does not."""
        level = self._level(points)
        times = _times(points, self.rate_scale)
        parts = np.concatenate([times, _whites(points, self.rate_scale)])
        whole = np.tensordot(self.variances[len(PLACES) :], parts, axes=1) * np.outer(level, level)
        return whole + self.own_V2 * times[1] + self.noise_V2 * np.eye(len(whole))

    def own_load(self, a: Points, b: Points) -> FloatArray:
        """(n, m) covariance in V^2 of what one run, whose points all of these are, has of its own of the load."""
        variance = self.variances[len(PLACES) + TIMES.index(OWN_LOAD)]
        alike = _places(a, b, self.rate_scale)[PLACES.index("load there")]
        return variance * alike * np.outer(self._level(a), self._level(b))

    def _places(self, a: Points, b: Points) -> FloatArray:
        return np.tensordot(self.variances[: len(PLACES)], _places(a, b, self.rate_scale), axes=1)

    def _level(self, points: Points) -> FloatArray:
        return level(points, self.known, self.unseen_V)

    @cached_property
    def _known_level(self) -> FloatArray:
        return self._level(self.known)

    @cached_property
    def _factor(self):  # noqa: ANN202
        own = self._places(self.known, self.known) * np.outer(self._known_level, self._known_level)
        own += self.in_time(self.known)
        return cho_factor(own + KNOWN.least_V**2 * np.eye(len(own)))

    @cached_property
    def _weights(self) -> FloatArray:
        return cho_solve(self._factor, self.left_V)


def level(points: Points, known: Points, unseen_V: FloatArray) -> FloatArray:
    """(n,) how large errors are near operating points, in V: a model is worst where the curve is steep, or in the cold.

    Parameters
    ----------
    points : where it is asked for
    known, unseen_V : points of the training runs, and their errors by fits that did not see them
    """
    squared = unseen_V**2
    mean = float(np.mean(squared))
    weight = np.exp(-0.5 * (_apart(points.soc, known.soc) / KNOWN.level_soc) ** 2)
    weight *= np.exp(-0.5 * (_apart(points.temperature_degC, known.temperature_degC) / KNOWN.temperature_K) ** 2)
    return np.sqrt((weight @ squared + KNOWN.level_points * mean) / (weight.sum(axis=1) + KNOWN.level_points))


# Causes of error: alike at like operating points; alike in time or in a whole run; alike nowhere. The load there has a
# part that is each run's own: a model is off by another resistance at low charge in each, which is none of the effects
# that go through a whole run.
PLACES = ("place", "load there", "load history there", "lead of the surface")
OWN_LOAD = "load there, own"
TIMES = ("minute", "quarter of an hour", "load, minute", "load, quarter", "slip", OWN_LOAD)
WHITE = ("white", "white under load")


_NONE = np.zeros(0)
_NOBODY = Points(_NONE, _NONE, _NONE, _NONE, np.zeros((0, 1)), _NONE, _NONE)
# Of a cell whose errors elsewhere are not known yet.
_CAUSES = len(PLACES) + len(TIMES) + len(WHITE)
UNLEARNED = Elsewhere(np.zeros(_CAUSES), {}, np.ones(1), _NOBODY, _NONE, _NONE)


def learn(
    points: Points, left_V: FloatArray, unseen_V: FloatArray, open_V2: FloatArray, effects: dict[str, FloatArray]
) -> Elsewhere:
    """Variances that make the errors most likely where fits did not see them.

    Parameters
    ----------
    points : of the training runs
    left_V, unseen_V : (m,) errors as fitted, and by fits that did not see them
    open_V2 : (m, m) covariance of the latter by what those fits leave open of the coefficients
    effects : by name, (m, m) covariance of effects of usual size that differ from run to run
    """
    scale = np.maximum(np.sqrt(np.mean(points.rates**2, axis=0)), 1e-3)
    own = np.concatenate([_places(points, points, scale), _times(points, scale), _whites(points, scale)])
    local = level(points, points, unseen_V)
    parts = np.concatenate([own * np.outer(local, local), *(each[None] for each in effects.values())])
    # A model that is far off on runs that it did not see is so in ways that look like effects, too.
    off = float(np.clip(np.sqrt(np.mean(unseen_V**2)) / KNOWN.usual_V, *KNOWN.usual_range))
    centre = np.log(np.array([KNOWN.share] * len(own) + [(KNOWN.granted * off) ** 2] * len(effects)))
    floor = KNOWN.least_V**2 * np.eye(len(unseen_V)) + open_V2

    # Covariances are symmetric: their lower triangles are half as much to read, a hundred times over.
    rows, columns = np.tril_indices(len(unseen_V))
    flat = rows * len(unseen_V) + columns
    halves, twice = parts.reshape(len(parts), -1).take(flat, axis=1), np.where(rows == columns, 1.0, 2.0)

    def cost(logs: FloatArray) -> tuple[float, FloatArray]:
        variances = np.exp(logs)
        whole = floor.copy()
        whole.ravel()[flat] += variances @ halves
        root = cholesky(whole, lower=True)
        inverse, _ = _POTRI(root, lower=1)
        white = cho_solve((root, True), unseen_V)
        away = (logs - centre) / KNOWN.share_spread
        value = float(np.sum(np.log(np.diag(root))) + 0.5 * unseen_V @ white + 0.5 * away @ away)
        slopes = halves @ (twice * (inverse.take(flat) - white.take(rows) * white.take(columns)))
        return value, 0.5 * slopes * variances + away / KNOWN.share_spread

    # No step of the search leaves what is possible: beyond it the matrix has no root in double precision.
    reach = KNOWN.most_spreads * KNOWN.share_spread
    bounds = np.column_stack([centre - reach, centre + reach])
    # Lazy: 0.5 s of processor time.
    from scipy.optimize import minimize

    found = minimize(cost, centre, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": KNOWN.steps})
    variances = np.exp(found.x)
    granted = dict(zip(effects, variances[len(own) :].tolist(), strict=True))
    return Elsewhere(variances[: len(own)], granted, scale, points, left_V, unseen_V)


def _places(a: Points, b: Points, rate_scale: FloatArray) -> FloatArray:
    """(4, n, m) covariances over operating points, of variance 1 at a usual one."""
    near = np.exp(-0.5 * (_apart(a.soc, b.soc) / KNOWN.soc) ** 2)
    near *= np.exp(-0.5 * (_apart(a.temperature_degC, b.temperature_degC) / KNOWN.temperature_K) ** 2)
    near *= np.outer(1.0 + a.away, 1.0 + b.away)
    own, other = a.rates / rate_scale, b.rates / rate_scale
    product = own @ other.T
    squares = (own**2).sum(axis=1)[:, None] + (other**2).sum(axis=1)[None, :] - 2.0 * product
    alike = np.exp(-0.5 * np.maximum(squares, 0.0) / KNOWN.rates**2)
    load = near * product / own.shape[1]
    return np.array([near, load, near * alike, load * np.outer(a.slope_V, b.slope_V)])


def _times(points: Points, rate_scale: FloatArray) -> FloatArray:
    """(6, n, n) covariances within each run: fading in time, and of what it has of its own of the load there."""
    gap = np.abs(_apart(points.time_s, points.time_s))
    same = np.where(_apart(points.run, points.run) == 0.0, np.outer(1.0 + points.away, 1.0 + points.away), 0.0)
    minute, quarter, slip = (same * np.exp(-gap / tau_s) for tau_s in (*KNOWN.fading_s, KNOWN.slip_s))
    now, slow = points.rates[:, 0] / rate_scale[0], points.rates[:, 2] / rate_scale[2]
    slopes = np.outer(points.slope_V, points.slope_V)
    return np.array(
        [
            minute,
            quarter,
            minute * np.outer(now, now),
            quarter * np.outer(slow, slow),
            slip * slopes,
            np.where(same > 0.0, _places(points, points, rate_scale)[PLACES.index("load there")], 0.0),
        ]
    )


def _whites(points: Points, rate_scale: FloatArray) -> FloatArray:
    """(2, n, n) of what does not hang together: always, and under load."""
    now = points.rates[:, 0] / rate_scale[0]
    return np.array([np.eye(len(now)), np.diag(now**2)])


def _apart(a: FloatArray, b: FloatArray) -> FloatArray:
    return a[:, None] - b[None, :]
