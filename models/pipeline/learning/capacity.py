"""What a cell holds now, from one run whose start is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from threadpoolctl import threadpool_limits

from models.comparison.start import Start, free_run_from_V, put_in_front
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.recursive.prior import update_rule
from models.recursive.settings import UpdateSettings
from models.uncertainty.bands import sensitivities

_ROUNDS, _MOVED = 4, 0.002
# Samples that the estimate is made from; those between them tell the same.
_SAMPLES = 1000
# Of the curve's slope where that is a parameter, relative: about a millivolt over a tenth of the charge.
_SLOPE_STD = 0.01
# Between two runs a cell does not lose more; such an estimate is of something else.
_MOST = 0.1
# An estimate is taken where it is this certain, in shares of the capacity.
_CERTAIN = 0.02


@dataclass(frozen=True)
class Capacity:
    """Capacity as a run shows it; `std_Ah` is 0 where the run does not tell it, and the model's stays."""

    value_Ah: float
    std_Ah: float


def capacity_from(network: LocalModelNetwork, run: GridRun, start: Start, settings: UpdateSettings) -> Capacity:
    """Estimate the capacity by the place on the open-circuit curve that the counted charge leads to.

    All that the update may move, curve and resistances of each local model, may have changed meanwhile by as much as it
    may move them, or have been wrong before: it is integrated out. Without that the run's charge would be told to a few
    hundredths of a percent and a tenth of what is lost would be left to the curve each time.

    Parameters
    ----------
    network : the model so far
    run : on its grid
    start : where it begins, taken as known
    settings : how far the parameters may have moved

    Returns
    -------
    Gauss-Newton on the generalised least squares over the capacity alone (Aitken 1936).
    """
    own_Ah = network.cell.capacity_Ah
    known = np.flatnonzero(np.isfinite(run.voltage_V))
    chosen = known[:: max(1, len(known) // _SAMPLES)]
    if len(chosen) < 2:
        return Capacity(own_Ah, 0.0)
    share, std = 1.0, np.inf
    with threadpool_limits(1, user_api="blas"):
        factor = cho_factor(_covariance_V2(network, run, start, chosen, len(known) / len(chosen), settings))
        for _ in range(_ROUNDS):
            now_V = _simulated_V(network, run, start, share)
            slope_V = ((_simulated_V(network, run, start, share + _MOVED) - now_V) / _MOVED)[chosen]
            error_V = (run.voltage_V - now_V)[chosen]
            if not (np.isfinite(slope_V).all() and np.isfinite(error_V).all() and np.ptp(slope_V) > 0.0):
                return Capacity(own_Ah, 0.0)
            weighted = cho_solve(factor, slope_V)
            std = float(1.0 / np.sqrt(slope_V @ weighted))
            share = float(np.clip(share + weighted @ error_V * std**2, 1.0 - 2.0 * _MOST, 1.0 + 2.0 * _MOST))
    if not (std < _CERTAIN and abs(share - 1.0) < _MOST):
        return Capacity(own_Ah, 0.0)
    return Capacity(own_Ah * share, own_Ah * std)


def with_capacity(network: LocalModelNetwork, capacity_Ah: float) -> LocalModelNetwork:
    """Return the model of a cell that holds so much."""
    return replace(network, cell=replace(network.cell, capacity_Ah=capacity_Ah))


def _simulated_V(network: LocalModelNetwork, run: GridRun, start: Start, share: float) -> FloatArray:
    return free_run_from_V(with_capacity(network, network.cell.capacity_Ah * share), run, start)


def _covariance_V2(
    network: LocalModelNetwork, run: GridRun, start: Start, chosen: np.ndarray, every: float, settings: UpdateSettings
) -> FloatArray:
    """(m, m) covariance of the chosen samples' errors in V^2: noise, and what the parameters may be off by.

    Parameters
    ----------
    chosen : samples of the run
    every : how many samples each of them stands for
    """
    rule, front = update_rule(network, replace(settings, slope_std=_SLOPE_STD)), put_in_front(network, run, start)
    data = network.dataset([front.run], [front.initial_soc])
    validity, (n_models, size) = network.partition.validity(data.z), network.theta.shape
    roots = [_root(prior) for prior in rule.prior]
    wanted = np.zeros(len(data), dtype=bool)
    wanted[chosen + front.n_before] = True
    out, first = np.empty((len(chosen), n_models * size)), 0
    for part, block in sensitivities(network.theta, network.structure.output_order, validity, data):
        rows = block[wanted[part]].reshape(-1, n_models, size)
        for model, root in enumerate(roots):
            out[first : first + len(rows), model * size : (model + 1) * size] = rows[:, model] @ root
        first += len(rows)
    return network.voltage_span_V**2 * (out @ out.T + rule.noise / every * np.eye(len(chosen)))


def _root(covariance: FloatArray) -> FloatArray:
    """Factor F of a covariance F F'."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))
