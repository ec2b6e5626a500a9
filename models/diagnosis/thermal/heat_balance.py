"""The lumped heat balance of the training runs: T = T_ambient + K low-pass of the heat, with the heat I (V - U)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from models.data.resampling import GridRun
from models.effects.thermal_view import ThermalView
from models.network.signals.filters import low_pass

_TIME_CONSTANT_S = (20.0, 20_000.0)
_GRID = 24
_LEAST_RISE_K = 0.5
_LEAST_RESISTANCE_K_PER_W = 1e-6


@dataclass(frozen=True)
class HeatBalance:
    """Thermal resistance, time constant, entropic coefficient, and the mean squared error of the temperature."""

    resistance_K_per_W: float
    time_constant_s: float
    dU_dT_V_per_K: float
    mse_K2: float


def _fitted(views: list[ThermalView]) -> HeatBalance:
    """Least squares on the simulated temperature: time constant by search, the rest linear."""
    known: dict[float, HeatBalance] = {}

    def judged(log_tau: float) -> float:
        tau_s = float(np.exp(log_tau))
        still = [replace(view, heat_W=0.0 * view.heat_W, time_constant_s=tau_s).simulated() for view in views]
        error = np.concatenate([view.temperature_degC - quiet for view, quiet in zip(views, still, strict=True)])
        sources = [[view.heat_W for view in views], [view.reversible_W for view in views]]
        warm = np.column_stack([np.concatenate([low_pass(part, tau_s, views[0].dt_s) for part in s]) for s in sources])
        gain, reversible = np.linalg.lstsq(warm, error, rcond=None)[0]
        gain = max(float(gain), _LEAST_RESISTANCE_K_PER_W)
        mse = float(np.mean((error - warm @ [gain, reversible]) ** 2))
        known[log_tau] = HeatBalance(gain, tau_s, float(reversible) / gain, mse)
        return mse

    grid = np.linspace(float(np.log(_TIME_CONSTANT_S[0])), float(np.log(_TIME_CONSTANT_S[1])), _GRID)
    best = int(np.argmin([judged(float(each)) for each in grid]))
    bounds = (float(grid[max(best - 1, 0)]), float(grid[min(best + 1, _GRID - 1)]))
    log_tau = float(minimize_scalar(judged, bounds=bounds, method="bounded").x)  # pyright: ignore[reportAttributeAccessIssue]
    judged(log_tau)
    return known[log_tau]


def fit_views(views: list[ThermalView]) -> HeatBalance | None:
    """Fit the heat balance to runs with their heat; None where the cell hardly warmed up."""
    rise = np.concatenate([view.temperature_degC - view.ambient_degC for view in views])
    return _fitted(views) if float(np.percentile(np.abs(rise), 99.0)) >= _LEAST_RISE_K else None


def has_temperature(run: GridRun) -> bool:
    """Whether cell and ambient temperature are known throughout."""
    if run.ambient_degC is None:
        return False
    return not (np.isnan(run.temperature_degC).any() or np.isnan(run.ambient_degC).any())
