"""Physical parameters of an effect with standard deviations, read from its smallest form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.diagnosis.evidence.candidates import Candidate, Comparison, lean_columns, noise_V2, simulate_again, try_lean
from models.diagnosis.evidence.evidence import Solution
from models.effects import Effect
from models.effects.effect import Lean, Local
from models.effects.spline import SplineBasis

_LOG_STEP = 0.02
_ITERATIONS = 4
# What a further column must explain, in units of the noise.
_WORTH = 10.0
# The shape may leave its grid by this factor.
_BEYOND = 1.5
_CURVE_POINTS = (0.1, 0.3, 0.5, 0.7, 0.9)


@dataclass(frozen=True)
class Value:
    """One parameter: value, standard deviation, unit."""

    value: float
    std: float | None
    unit: str


def parameters(comparison: Comparison, candidate: Candidate) -> dict[str, Value]:
    """Read the parameters of an effect that was tried on the voltage."""
    effect, noise = candidate.effect, noise_V2(comparison, candidate)
    primary = effect.parameters[0]
    if effect.shift is not None and candidate.value is None:
        candidate = simulate_again(comparison, effect)
    if effect.shift is not None and candidate.value is not None and candidate.variance is not None:
        view = comparison.runs.views[0]
        value = effect.shift.physical(view, candidate.value)
        step = effect.shift.step(view)
        slope = (effect.shift.physical(view, candidate.value + step) - value) / step
        return {primary.name: Value(value, abs(slope) * float(np.sqrt(candidate.variance * noise)), primary.unit)}
    if effect.lean is not None:
        return _lean(comparison, effect, effect.lean, noise)
    if effect.local is not None:
        return _curve(comparison, effect, effect.local, candidate.solution, noise)
    std = float(np.sqrt(candidate.solution.covariance[0, 0] * noise))
    return {primary.name: Value(float(candidate.solution.coefficients[0]), std, primary.unit)}


def _lean(comparison: Comparison, effect: Effect, lean: Lean, noise: float) -> dict[str, Value]:
    """Best shape on the grid, then Gauss-Newton on its logarithm."""
    evidence = comparison.evidence
    shapes = lean.shapes(comparison.runs.views[0])
    best = try_lean(comparison, effect, _WORTH * noise)
    shape = best.shape
    x = lean_columns(comparison, lean, shape)[:, : best.columns]
    found = evidence.solve(x)
    if len(shapes) > 1:
        for _ in range(_ITERATIONS):
            moved = lean_columns(comparison, lean, shape * np.exp(_LOG_STEP))[:, : best.columns] - x
            slope = (moved @ found.coefficients[: best.columns]) / _LOG_STEP
            found = evidence.solve(np.column_stack([x, slope]))
            step = float(np.clip(found.coefficients[-1], -0.5, 0.5))
            shape = float(np.clip(shape * np.exp(step), min(shapes) / _BEYOND, max(shapes) * _BEYOND))
            x = lean_columns(comparison, lean, shape)[:, : best.columns]
            if abs(step) < _LOG_STEP:
                break
    std = np.sqrt(np.diag(found.covariance) * noise)
    first = effect.parameters[0]
    values = {first.name: Value(lean.scale * float(found.coefficients[0]), lean.scale * float(std[0]), first.unit)}
    if len(shapes) > 1 and len(effect.parameters) > 1:
        second = effect.parameters[1]
        known = float(std[-1]) * shape if len(std) > x.shape[1] else None
        values[second.name] = Value(shape, known, second.unit)
    return values


def _curve(comparison: Comparison, effect: Effect, local: Local, solution: Solution, noise: float) -> dict[str, Value]:
    """Values of the curve at some SoC."""
    model = comparison.runs.views[0].model
    low, high = model.soc_range
    points = low + np.array(_CURVE_POINTS) * (high - low)
    bumps = local.scale * SplineBasis(low, high, local.size).matrix(points)
    values = bumps @ solution.coefficients
    std = np.sqrt(np.maximum(np.diag(bumps @ solution.covariance @ bumps.T), 0.0) * noise)
    first = effect.parameters[0]
    return {
        f"{first.name} at SoC {soc:.2f}": Value(float(v), float(s), first.unit)
        for soc, v, s in zip(points, values, std, strict=True)
    }
