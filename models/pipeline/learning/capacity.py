"""What a cell holds now, from one run whose start is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.comparison.start import Start, free_run_from_V
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.network.signals.filters import low_pass
from models.uncertainty.correlated_errors import least_squares_covariance

_ROUNDS, _MOVED = 4, 0.002
# What else may have changed meanwhile, and must not pass for capacity: resistances of every pace.
_TIMES_S = (3.0, 30.0, 300.0, 1500.0)
# Between two runs a cell does not lose more; such an estimate is of something else.
_MOST = 0.1
# An estimate is taken where it is this certain, in shares of the capacity.
_CERTAIN = 0.01


@dataclass(frozen=True)
class Capacity:
    """Capacity as a run shows it; `std_Ah` is 0 where the run does not tell it, and the model's stays."""

    value_Ah: float
    std_Ah: float


def capacity_from(network: LocalModelNetwork, run: GridRun, start: Start) -> Capacity:
    """Estimate the capacity by the place on the open-circuit curve that the counted charge leads to.

    Parameters
    ----------
    network : the model so far
    run : on its grid
    start : where it begins, taken as known

    Returns
    -------
    Gauss-Newton, with changes of the resistances, an offset of the voltage and its slope over temperature beside it.
    """
    own_Ah = network.cell.capacity_Ah
    beside = _beside(run)
    known, share, std = np.isfinite(run.voltage_V), 1.0, np.inf
    for _ in range(_ROUNDS):
        now_V = _simulated_V(network, run, start, share)
        slope_V = (_simulated_V(network, run, start, share + _MOVED) - now_V) / _MOVED
        columns = np.column_stack([slope_V, *beside])
        there = known & np.isfinite(columns).all(axis=1) & np.isfinite(now_V)
        x, error_V = columns[there], (run.voltage_V - now_V)[there]
        x = x[:, np.ptp(x, axis=0) > 0.0]
        if x.shape[1] == 0 or len(x) <= 2 * x.shape[1] or not np.ptp(slope_V[there]) > 0.0:
            return Capacity(own_Ah, 0.0)
        scale = np.linalg.norm(x, axis=0)
        level = np.column_stack([x / scale, np.ones(len(x)) / np.sqrt(len(x))])
        found = np.linalg.lstsq(level, error_V, rcond=None)[0]
        share = float(np.clip(share + found[0] / scale[0], 1.0 - 2.0 * _MOST, 1.0 + 2.0 * _MOST))
        left_V = error_V - level @ found
        covariance = least_squares_covariance(level, left_V) if np.linalg.cond(level) < 1e8 else None
        std = np.inf if covariance is None else float(np.sqrt(covariance[0, 0])) / scale[0]
    if not (std < _CERTAIN and abs(share - 1.0) < _MOST):
        return Capacity(own_Ah, 0.0)
    return Capacity(own_Ah * share, own_Ah * std)


def with_capacity(network: LocalModelNetwork, capacity_Ah: float) -> LocalModelNetwork:
    """Return the model of a cell that holds so much."""
    return replace(network, cell=replace(network.cell, capacity_Ah=capacity_Ah))


def _simulated_V(network: LocalModelNetwork, run: GridRun, start: Start, share: float) -> FloatArray:
    return free_run_from_V(with_capacity(network, network.cell.capacity_Ah * share), run, start)


def _beside(run: GridRun) -> list[FloatArray]:
    filtered = [low_pass(run.current_A, time_s, run.dt_s) for time_s in _TIMES_S]
    degC = run.temperature_degC
    return [run.current_A, *filtered, *([degC] if np.isfinite(degC).all() else [])]
