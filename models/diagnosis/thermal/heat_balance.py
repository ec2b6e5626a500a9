"""The lumped heat balance of the training runs: T = T_ambient + K low-pass of the heat, with the heat I (V - U).

A sensor that reads too much by the same in all of them is no news in another run, nor is a skin that follows heat and
chamber sooner than the inside does: both are part of the balance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.effects.thermal_view import ThermalView

_TIME_CONSTANT_S = (20.0, 20_000.0)
_GRID = 24
# Places of the grid about which a time constant is looked for: the lowest need not lead to the best.
_LOWEST = 2
_LEAST_RISE_K = 0.5
_LEAST_RESISTANCE_K_PER_W = 1e-6
# A sensor that was put on with care, and what a skin of a small cell may do sooner.
_USUAL_OFFSET_K, _USUAL_QUICK = 0.3, 0.2
_NONE = {"dU_dT_V_per_K": 0.0, "offset_K": 0.0, "quick_heat": 0.0, "quick_chamber": 0.0}


@dataclass(frozen=True)
class HeatBalance:
    """What warms and cools the cell, as the training runs have it.

    Attributes
    ----------
    resistance_K_per_W, time_constant_s, dU_dT_V_per_K : thermal resistance, time constant, and entropic coefficient
    mse_K2 : mean squared error of the temperature
    offset_K : what the sensor reads too much
    quick_heat, quick_chamber : shares by which the skin follows the heat and the chamber sooner
    """

    resistance_K_per_W: float
    time_constant_s: float
    dU_dT_V_per_K: float
    mse_K2: float
    offset_K: float = 0.0
    quick_heat: float = 0.0
    quick_chamber: float = 0.0


def _fitted(views: list[ThermalView]) -> HeatBalance:
    """Least squares on the simulated temperature: time constant by search, the rest linear."""
    known: dict[float, HeatBalance] = {}

    def judged(log_tau: float) -> float:
        tau_s = float(np.exp(log_tau))
        still = [replace(view, heat_W=0.0 * view.heat_W, time_constant_s=tau_s, **_NONE).simulated() for view in views]
        error = np.concatenate([view.temperature_degC - quiet for view, quiet in zip(views, still, strict=True)])
        columns = np.vstack([view.responses(tau_s) for view in views])
        found, unusual_K2 = _shrunk(columns, error, tau_s / views[0].dt_s)
        mse = float(np.mean((error - columns @ found) ** 2))
        gain, reversible, offset_K, heat, quick_chamber = found.tolist()
        gain = max(gain, _LEAST_RESISTANCE_K_PER_W)
        known[log_tau] = HeatBalance(gain, tau_s, reversible / gain, mse, offset_K, heat / gain, quick_chamber)
        # Several times the time constant with a skin that all follows sooner is nearly the same for heat and chamber,
        # but not for what else goes by it.
        return mse + unusual_K2

    # Lazy: 0.5 s of processor time.
    from scipy.optimize import minimize_scalar

    grid = np.linspace(float(np.log(_TIME_CONSTANT_S[0])), float(np.log(_TIME_CONSTANT_S[1])), _GRID)
    costs = np.pad([judged(float(each)) for each in grid], 1, constant_values=np.inf)
    lowest = np.flatnonzero((costs[1:-1] <= costs[:-2]) & (costs[1:-1] <= costs[2:]))
    found = []
    for best in lowest[np.argsort(costs[1 + lowest])][:_LOWEST]:
        bounds = (float(grid[max(best - 1, 0)]), float(grid[min(best + 1, _GRID - 1)]))
        log_tau = float(minimize_scalar(judged, bounds=bounds, method="bounded").x)  # pyright: ignore[reportAttributeAccessIssue]
        found.append((judged(log_tau), log_tau))
    return known[min(found)[1]]


def _shrunk(columns: FloatArray, error: FloatArray, alike: float) -> tuple[FloatArray, float]:
    """(5,) least squares, and in K^2 of the mean square how unusual the last three are.

    These are held to what is usual, for `alike` samples together tell one thing.
    """
    n = len(error)
    first = np.linalg.lstsq(columns, error, rcond=None)[0]
    mse = float(np.mean((error - columns @ first) ** 2))
    usual = np.array([_USUAL_OFFSET_K, _USUAL_QUICK * max(abs(first[0]), _LEAST_RESISTANCE_K_PER_W), _USUAL_QUICK])
    held = np.concatenate([np.zeros(2), max(alike, 1.0) * mse / usual**2])
    found = np.linalg.solve(columns.T @ columns + np.diag(held) + 1e-12 * n * np.eye(5), columns.T @ error)
    return found, float(held @ found**2) / n


def fit_views(views: list[ThermalView]) -> HeatBalance | None:
    """Fit the heat balance to runs with their heat; None where the cell hardly warmed up.

    None as well where it does not become warmer by its heat: what moves its temperature then is something else, a
    chamber that swings as a rule, and a balance would explain anything.
    """
    rise = np.concatenate([view.temperature_degC - view.ambient_degC for view in views])
    if float(np.percentile(np.abs(rise), 99.0)) < _LEAST_RISE_K:
        return None
    found = _fitted(views)
    return found if found.resistance_K_per_W > _LEAST_RESISTANCE_K_PER_W else None


def has_temperature(run: GridRun) -> bool:
    """Whether cell and ambient temperature are known throughout."""
    if run.ambient_degC is None:
        return False
    return not (np.isnan(run.temperature_degC).any() or np.isnan(run.ambient_degC).any())
