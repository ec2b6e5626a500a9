"""Judged runs as the evidence sees them: points of voltage and temperature, with all that is not known of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.elsewhere import Points, points_of
from models.diagnosis.known.memory import KnownRuns, simulated_heat
from models.diagnosis.known.points import spread
from models.diagnosis.known.start import SOC_COLUMNS, start_columns
from models.diagnosis.known.thresholds import KNOWN
from models.diagnosis.likelihood.background import Background
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.diagnosis.thermal.heat_balance import has_temperature
from models.effects.thermal_view import ThermalView
from models.effects.view import View
from models.network.signals.filters import low_pass

# Judged runs are told from training runs by numbers far from theirs.
_JUDGED = 1000
# A start's likeliest state of charge is found in so many steps along the slope.
_START_STEPS = 4


@dataclass(frozen=True)
class RunSight:
    """One judged run.

    Attributes
    ----------
    every : the run with all samples for which effects are simulated
    points : the run with those whose voltage is looked at
    place : (m,) where these are among the former
    warm : its heat; None where the temperature cannot be judged
    warm_place : (w,) samples whose temperature is looked at
    """

    every: View
    points: View
    place: np.ndarray
    warm: ThermalView | None
    warm_place: np.ndarray


@dataclass(frozen=True)
class Sight:
    """All judged runs.

    Attributes
    ----------
    known : of the training runs
    runs : one for each
    share_inside : share of the samples within the trained state of charge
    """

    known: KnownRuns
    runs: tuple[RunSight, ...]
    share_inside: float

    @property
    def n_voltage(self) -> int:
        """Number of voltage points."""
        return sum(len(run.place) for run in self.runs)

    @property
    def own_rows(self) -> list[np.ndarray]:
        """(N,) whether a point belongs to a run, for each run."""
        numbers = [np.full(len(run.place), i) for i, run in enumerate(self.runs)]
        numbers += [np.full(len(run.warm_place), i) for i, run in enumerate(self.runs)]
        every = np.concatenate(numbers)
        return [every == i for i in range(len(self.runs))]

    def stacked(self, volts: list[FloatArray], kelvins: list[FloatArray] | None = None) -> FloatArray:
        """(N, k) voltage of all runs' points and then temperature; none: the temperature does not change."""
        if kelvins is None:
            kelvins = [np.zeros((len(run.warm_place), *volts[0].shape[1:])) for run in self.runs]
        return np.concatenate([*volts, *kelvins])

    def warmed(self, run: RunSight, heat_W: FloatArray) -> FloatArray:
        """(w, k) K that (n, k) more heat makes of a run's temperature."""
        if run.warm is None:
            return np.zeros((0, heat_W.shape[1]))
        warm, k = run.warm, heat_W.shape[1]
        rise = [low_pass(heat_W[:, j], warm.time_constant_s, warm.dt_s) for j in range(k)]
        return warm.resistance_K_per_W * np.column_stack(rise)[run.warm_place]


def look(
    known: KnownRuns,
    runs: list[GridRun],
    soc: list[float],
    moved: Callable[[View], FloatArray] | None = None,
    share: float = 1.0,
) -> Sight:
    """Choose the samples of judged runs that are looked at.

    Parameters
    ----------
    known : of the training runs
    runs, soc : to be judged, with their SoC at the start
    moved : view -> (n,) state of charge by which a sample must lie within what was trained, too
    share : of the usual number of samples; fewer are quicker, and errors that hang together make most of them repeat

    Raises
    ------
    ModelError
        None of them lies within the trained state of charge.
    """
    cell, at = known.cell, THRESHOLDS
    stride = max(1, -(-sum(len(run) for run in runs) // round(share * at.simulated)))
    views = [View(cell, run, start, np.arange(0, len(run), stride)) for run, start in zip(runs, soc, strict=True)]
    low, high = cell.soc_range
    inside = [
        view.run.measured[view.index]
        & _between(view.soc[view.index] + view.inputs.surface, *cell.surface_range)
        & np.all(
            [_between(each[view.index], low, high) for each in [view.soc, *([moved(view)] if moved else [])]], axis=0
        )
        for view in views
    ]
    total = sum(int(each.sum()) for each in inside)
    if not total:
        start = ", ".join(f"{view.soc.min():.2f} to {view.soc.max():.2f}" for view in views)
        raise ModelError(
            f"no sample lies within the trained state of charge, {low:.2f} to {high:.2f}; the runs go through {start}: "
            "give the right SoC at the start, or train on runs that cover it"
        )
    judged, every = [], sum(len(view.index) for view in views)
    for number, (view, part) in enumerate(zip(views, inside, strict=True)):
        places = np.flatnonzero(part)
        place = places[spread(len(places), round(share * at.voltage_points * len(places) / total), number)]
        points = replace(view, index=view.index[place])
        warm, warm_place = None, np.zeros(0, dtype=np.int64)
        if known.balance is not None and has_temperature(view.run):
            warm = simulated_heat(cell, view, stride, known.balance)
            count = max(1, round(share * at.temperature_points * len(view.index) / every))
            warm_place = spread(len(view.index), count, number)
        judged.append(RunSight(view, points, place, warm, warm_place))
    measured = sum(int(view.run.measured[view.index].sum()) for view in views)
    return Sight(known, tuple(judged), total / measured)


def _between(soc: FloatArray, low: float, high: float) -> np.ndarray:
    return (soc >= low - THRESHOLDS.soc_margin) & (soc <= high + THRESHOLDS.soc_margin)


def background(sight: Sight, soc_std: list[float] | None, granted: FloatArray) -> Background:
    """What the judged runs would be like with nothing new.

    Parameters
    ----------
    sight : of the runs
    soc_std : standard deviation of each run's stated state of charge; None: nothing of the starts is open
    granted : (N, k) columns of effects that are there in any log and no news
    """
    known, n = sight.known, sight.n_voltage
    points = Points.joined([points_of(run.points, _JUDGED + i, known.cell.domain) for i, run in enumerate(sight.runs)])
    mean_V, elsewhere_V2 = known.elsewhere.conditional(points)
    elsewhere_V2 = elsewhere_V2 + known.elsewhere.in_time(points)
    rows = np.vstack([known.cell.regressors(run.points.inputs, run.points.soc[run.points.index]) for run in sight.runs])
    fixed_V2 = rows @ known.cell.covariance @ rows.T
    first, starts = 0, [np.zeros((n, 0))]
    for run, std in zip(sight.runs, soc_std or [None] * len(sight.runs), strict=True):
        own = slice(first, first + len(run.place))
        if std is not None:
            columns = start_columns(known.cell, run.points, std)
            fixed_V2[own, own] += columns @ columns.T
            fading = columns[:, SOC_COLUMNS:]
            starts.append(np.zeros((n, fading.shape[1])))
            starts[-1][own] = fading
        first = own.stop
    fixed_V2[np.diag_indices(n)] += KNOWN.least_V**2
    error_V = np.concatenate([run.points.residual_V for run in sight.runs]) - mean_V
    error_K, fixed_K2, elsewhere_K2 = _temperature(sight)
    size = n + len(error_K)
    fixed, elsewhere = np.zeros((size, size)), np.zeros((size, size))
    fixed[:n, :n], fixed[n:, n:] = fixed_V2, fixed_K2
    elsewhere[:n, :n], elsewhere[n:, n:] = elsewhere_V2, elsewhere_K2
    # By their size: a cell whose errors hang together for a third is far from known to the noise.
    white = 1.0 - float(np.sqrt(max(1.0 - known.elsewhere.white_share, 0.0)))
    tempering = (1.0 - white) * THRESHOLDS.tempering + white * THRESHOLDS.tempering_white
    began = np.vstack([np.hstack(starts), np.zeros((size - n, sum(each.shape[1] for each in starts)))])
    return Background(
        np.concatenate([error_V, error_K]), fixed, elsewhere + granted @ granted.T, tempering, starts=began
    )


def gain_of_start(sight: Sight, back: Background, soc_std: list[float] | None) -> float:
    """By how much the logarithm of nothing grows where the runs begin at the likeliest state of charge.

    What is open at a start is straight along the state of charge in `background`. Where the curve bends, the voltage of
    a start that is off by two or three standard deviations is another one.

    Parameters
    ----------
    sight, back : of the runs, with nothing new
    soc_std : as in `background`
    """
    if soc_std is None:
        return 0.0
    std, moved = np.array(soc_std), np.zeros(len(soc_std))
    there = _begun(sight, back, std, moved)
    for _ in range(_START_STEPS):
        error, fixed, columns = there
        moved = columns.T @ cho_solve(cho_factor(fixed + back.elsewhere, lower=True), error)
        moved = np.clip(moved, -THRESHOLDS.start_spreads, THRESHOLDS.start_spreads)
        if np.abs(moved).max() < 1.0:
            return 0.0
        there = _begun(sight, back, std, moved)
    return max(replace(back, error=there[0], fixed=there[1]).nothing - back.nothing, 0.0)


def _begun(
    sight: Sight, back: Background, std: FloatArray, moved: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Error and covariance of nothing about starts `moved` by so many `std`, and (N, R) what one of these makes there.

    The error is that of a start that is off by none of them, along the slope about the moved one.
    """
    error, fixed, first = back.error.copy(), back.fixed.copy(), 0
    columns = np.zeros((len(error), len(std)))
    for i, run in enumerate(sight.runs):
        own = slice(first, first + len(run.place))
        view = replace(run.points, initial_soc=run.points.initial_soc + float(moved[i] * std[i]))
        was, now = (start_columns(sight.known.cell, each, std[i])[:, :SOC_COLUMNS] for each in (run.points, view))
        columns[own, i] = now[:, 0]
        error[own] += view.residual_V - run.points.residual_V + moved[i] * now[:, 0]
        fixed[own, own] += now @ now.T - was @ was.T
        first = own.stop
    return error, fixed, columns


def _temperature(sight: Sight) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(w,) error of the temperature in K, and the covariances of what is known of it and of the model's own error."""
    at, errors, fixed, own = THRESHOLDS, [], [], []
    for run in sight.runs:
        if run.warm is None or sight.known.balance is None:
            continue
        time_s = run.every.run.time_s[run.every.index[run.warm_place]]
        errors.append((run.warm.temperature_degC - run.warm.simulated())[run.warm_place])
        began = at.start_K * np.exp(-time_s / run.warm.time_constant_s)
        fixed.append(np.outer(began, began) + at.white_K**2 * np.eye(len(time_s)))
        fading = np.exp(-np.abs(time_s[:, None] - time_s[None, :]) / run.warm.time_constant_s)
        own.append(at.heat_error**2 * sight.known.balance.mse_K2 * fading)
    if not errors:
        return np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0))
    return np.concatenate(errors), _block(fixed), _block(own)


def _block(parts: list[FloatArray]) -> FloatArray:
    size = sum(len(part) for part in parts)
    out, first = np.zeros((size, size)), 0
    for part in parts:
        out[first : first + len(part), first : first + len(part)] = part
        first += len(part)
    return out
