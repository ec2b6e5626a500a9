"""Which effect changed the cell's temperature, against the heat balance of the training runs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.reference.reference import Reference
from models.diagnosis.thermal.heat_balance import HeatBalance, has_temperature, thermal_view
from models.effects import Effect
from models.effects.effect import Warmth
from models.effects.reading import Values
from models.effects.thermal_view import ThermalView

_ITERATIONS = 12
_HALVINGS = 8
# Least error that is worth a finding: absolute, and relative to that on the training runs.
_LEAST_K, _LEAST_RATIO = 0.25, 2.0
# Fewer tell nothing of a heat balance.
_FEWEST_SAMPLES = 100


@dataclass(frozen=True)
class WarmthTrial:
    """One effect on the temperature.

    Attributes
    ----------
    effect : tried
    values, std : of its parameters, physical
    mse_K2 : mean squared error that remains
    """

    effect: Effect
    values: tuple[float, ...]
    std: tuple[float, ...]
    mse_K2: float

    @property
    def named_values(self) -> Values:
        """Values by the names of the parameters."""
        return {each.name: value for each, value in zip(self.effect.parameters, self.values, strict=True)}


@dataclass(frozen=True)
class ThermalComparison:
    """Temperature of the diagnosed runs against the heat balance of the training runs.

    Attributes
    ----------
    views : of the diagnosed runs
    own_mse_K2 : mean squared error on the training runs
    mse_K2 : on the diagnosed runs
    trials : every effect on the temperature, the best first
    pairs : every two of them at once, the best first; none where the error is not large
    """

    views: tuple[ThermalView, ...]
    own_mse_K2: float
    mse_K2: float
    trials: tuple[WarmthTrial, ...]
    pairs: tuple[tuple[WarmthTrial, ...], ...]

    @property
    def large(self) -> bool:
        """Whether the error goes well beyond that on the training runs."""
        return self.mse_K2 >= max(_LEAST_K**2, _LEAST_RATIO**2 * self.own_mse_K2)

    def share_of_new(self, trial: WarmthTrial) -> float:
        """Share that a trial explains of what goes beyond the error on the training runs."""
        return (self.mse_K2 - trial.mse_K2) / max(self.mse_K2 - self.own_mse_K2, 1e-12)

    def share(self, trial: WarmthTrial) -> float:
        """Share of the squared error that a trial explains."""
        return 1.0 - trial.mse_K2 / self.mse_K2 if self.mse_K2 > 0.0 else 0.0


def compare_temperature(
    reference: Reference,
    balance: HeatBalance | None,
    runs: list[GridRun],
    soc: list[float],
    effects: list[Effect],
    heatless_V: list[FloatArray],
) -> ThermalComparison | None:
    """Try every effect on the temperature.

    Parameters
    ----------
    reference : model whose open-circuit voltage the heat is counted from
    balance : of the training runs
    runs, soc : to be diagnosed, with their SoC at the start
    effects : to be tried
    heatless_V : (n,) for each run, part of its voltage that warms nothing: a shifted curve, an offset

    Returns
    -------
    None where ambient temperature is missing, there is no heat balance, or there are too few samples.
    """
    if balance is None or not all(has_temperature(run) for run in runs):
        return None
    if sum(len(run) for run in runs) < _FEWEST_SAMPLES:
        return None
    views = tuple(
        replace(
            thermal_view(reference, run, s, part),
            resistance_K_per_W=balance.resistance_K_per_W,
            time_constant_s=balance.time_constant_s,
            dU_dT_V_per_K=balance.dU_dT_V_per_K,
        )
        for run, s, part in zip(runs, soc, heatless_V, strict=True)
    )
    mse = float(np.mean(np.concatenate([view.temperature_degC - view.simulated() for view in views]) ** 2))
    warm = [effect for effect in effects if effect.warmth is not None]
    trials = sorted((_fit(views, (effect,))[0] for effect in warm), key=lambda trial: trial.mse_K2)
    found = ThermalComparison(views, balance.mse_K2, mse, tuple(trials), ())
    if not found.large:
        return found
    # Two errors of the reading cannot be told apart in it.
    told = [pair for pair in combinations(warm, 2) if not all(_of_reading(effect) for effect in pair)]
    pairs = sorted((_fit(views, pair) for pair in told), key=lambda pair: pair[0].mse_K2)
    return replace(found, pairs=tuple(pairs))


def _of_reading(effect: Effect) -> bool:
    return effect.warmth is not None and effect.warmth.moved is None


def _fit(views: tuple[ThermalView, ...], effects: tuple[Effect, ...]) -> tuple[WarmthTrial, ...]:
    """All effects at once by Gauss-Newton with halved steps; those on the heat balance come before the reading."""
    parts = [(effect, effect.warmth) for effect in effects if effect.warmth is not None]
    parts.sort(key=lambda part: part[1].moved is None)
    edges = np.cumsum([0, *(len(warmth.start) for _, warmth in parts)])

    def own(values: tuple[float, ...], number: int) -> tuple[float, ...]:
        return values[edges[number] : edges[number + 1]]

    def before(view: ThermalView, values: tuple[float, ...], number: int) -> ThermalView:
        for i, (_, warmth) in enumerate(parts[:number]):
            assert warmth.moved is not None
            view = warmth.moved(view, own(values, i))
        return view

    def error(values: tuple[float, ...]) -> FloatArray:
        last = len(parts) - 1
        each = [parts[last][1].temperature(before(view, values, last), own(values, last)) for view in views]
        return np.concatenate([view.temperature_degC - found for view, found in zip(views, each, strict=True)])

    steps = [step for _, warmth in parts for step in warmth.step]
    values = tuple(start for _, warmth in parts for start in warmth.start)
    remaining = error(values)
    jacobian = np.zeros((len(remaining), len(values)))
    for _ in range(_ITERATIONS):
        for i, step in enumerate(steps):
            moved = (*values[:i], values[i] + step, *values[i + 1 :])
            jacobian[:, i] = (remaining - error(moved)) / step
        move = np.linalg.lstsq(jacobian, remaining, rcond=None)[0]
        better, factor = None, 1.0
        for _ in range(_HALVINGS):
            trial = tuple(float(v + factor * m) for v, m in zip(values, move, strict=True))
            left = error(trial)
            if left @ left < remaining @ remaining:
                better = (trial, left)
                break
            factor *= 0.5
        if better is None:
            break
        small = bool(np.all(np.abs(factor * move) < 0.01 * np.array(steps)))
        values, remaining = better
        if small:
            break
    std = np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian)) * _variance(remaining))
    mse_K2 = float(np.mean(remaining**2))
    found = []
    for number, (effect, warmth) in enumerate(parts):
        of_effect = slice(edges[number], edges[number + 1])
        found.append(_physical(views[0], effect, warmth, values[of_effect], std[of_effect], mse_K2))
    return tuple(found)


def _physical(
    view: ThermalView, effect: Effect, warmth: Warmth, values: tuple[float, ...], std: FloatArray, mse_K2: float
) -> WarmthTrial:
    physical, told = warmth.physical(view, values), []
    for i, step in enumerate(warmth.step):
        moved = warmth.physical(view, (*values[:i], values[i] + step, *values[i + 1 :]))
        told.append(abs(moved[i] - physical[i]) / step * float(std[i]))
    return WarmthTrial(effect, physical, tuple(told), mse_K2)


def _variance(error: FloatArray) -> float:
    """Variance of an error that hangs together in time, as its sum over long blocks shows it."""
    blocks = np.array_split(error, max(10, len(error) // 2000))
    together = float(np.mean([block.sum() ** 2 / len(block) for block in blocks]))
    return max(together, float(np.mean(error**2)))
