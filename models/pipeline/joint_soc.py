"""Initial states of charge of all training runs at once, with what the network's parameters would do about them.

A model follows the states of charge that it is fitted to: run by run, each round would find a share of what is left
only. Here the parameters are free to follow (variable projection, Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973), so
that one step finds all of what can be told. A shift that all runs share moves the open-circuit curve along, and where
the local models lie with it: it shows nowhere, and stays as uncertain as the mean of what was said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from models.comparison.start import free_run_from_V
from models.comparison.start_noise import seen_error_model
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.network.recursion import initial_samples
from models.pipeline.training import Training
from models.uncertainty.bands import sensitivities

# Samples in the sums; neighbours tell the same.
_SAMPLES = 30_000
_MOVED = 1e-3
# Directions of the parameters that the runs do not excite are held.
_RIDGE = 1e-9
# Runs contradict each other only where they meet: with less than this share of its samples at states of charge that
# another run has too, a run is as right as it says.
_LEAST_SHARED = 0.1


def joint_soc(
    network: LocalModelNetwork, data: Training, stated: Sequence[float], soc_std: float
) -> tuple[FloatArray, FloatArray]:
    """Initial state of charge of each training run, and its standard deviation.

    Parameters
    ----------
    network : fitted to the data
    data : runs with their present starts
    stated, soc_std : what was said of each, and how far off that may be

    Returns
    -------
    soc, std : (R,)
    """
    now, said = np.array(data.soc), np.asarray(stated, dtype=np.float64)
    errors_V = [
        run.voltage_V - free_run_from_V(network, run, start) for run, start in zip(data.grid, data.starts, strict=True)
    ]
    expected = seen_error_model(errors_V)
    with threadpool_limits(1, user_api="blas"):
        information, gradient, every = _projected(network, data, errors_V)
    # A sample of a slow error is worth a part of an independent one.
    weight = every / (expected.level_V**2 * max(expected.correlation.inflation, every))
    spread = np.linalg.inv(weight * information + np.eye(len(now)) / soc_std**2)
    step = spread @ (weight * gradient + (said - now) / soc_std**2)
    meets = meeting(data)
    n = max(int(meets.sum()), 1)
    apart = np.diag(meets.astype(np.float64)) - np.outer(meets, meets) / n
    variance = np.diag(apart @ spread @ apart) + soc_std**2 / n
    found = within(said + apart @ (now + step - said), said)
    return found, np.where(meets, np.minimum(np.sqrt(variance), soc_std), soc_std)


def meeting(data: Training) -> np.ndarray:
    """(R,) whether enough of a run's samples lie at states of charge that another run has too."""
    counted = data.counted_soc()
    shared = np.zeros(len(counted))
    for k, soc in enumerate(counted):
        others = [each for i, each in enumerate(counted) if i != k]
        met = [(soc >= each.min()) & (soc <= each.max()) for each in others]
        shared[k] = float(np.logical_or.reduce(met).mean()) if met else 0.0
    return shared >= _LEAST_SHARED


def within(soc: FloatArray, said: FloatArray) -> FloatArray:
    """(R,) states of charge, none beyond empty or full by more than was said."""
    return np.clip(soc, np.minimum(said, 0.0), np.maximum(said, 1.0))


def _projected(
    network: LocalModelNetwork, data: Training, errors_V: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray, int]:
    """(R, R) information on the states of charge and (R,) gradient, parameters eliminated; and of how many each."""
    fronts = [len(fit) - len(run) for fit, run in zip(data.fit_grid, data.grid, strict=True)]
    error = np.concatenate([_after(n, each) for n, each in zip(fronts, errors_V, strict=True)])
    slope = np.concatenate([_after(n, each) for n, each in zip(fronts, _slopes(network, data), strict=True)])
    samples = network.dataset(data.fit_grid, data.fit_soc)
    order, run_index = network.structure.output_order, samples.run_index
    counted = ~np.isnan(error) & (initial_samples(len(samples), samples.starts, order) == 0)
    every = max(1, int(counted.sum()) // _SAMPLES)
    counted &= np.arange(len(samples)) % every == 0
    size, runs = network.theta.size, len(data.grid)
    own, cross, down = np.zeros((size, size)), np.zeros((size, runs)), np.zeros(size)
    validity = network.partition.validity(samples.z)
    for part, block in sensitivities(network.theta, order, validity, samples):
        chosen = counted[part]
        rows = network.voltage_span_V * block[chosen]
        own += rows.T @ rows
        down += rows.T @ error[part][chosen]
        np.add.at(cross.T, run_index[part][chosen], rows * slope[part][chosen, None])
    squares = np.bincount(run_index[counted], slope[counted] ** 2, minlength=runs)
    plain = np.bincount(run_index[counted], slope[counted] * error[counted], minlength=runs)
    solved = np.linalg.solve(own + _RIDGE * np.trace(own) / size * np.eye(size), np.column_stack([cross, down]))
    return np.diag(squares) - cross.T @ solved[:, :-1], plain - cross.T @ solved[:, -1], every


def _after(n_before: int, values: FloatArray) -> FloatArray:
    return np.concatenate([np.full(n_before, np.nan), values])


def _slopes(network: LocalModelNetwork, data: Training) -> list[FloatArray]:
    """(n,) derivative of each run's voltage to its initial state of charge, in V."""
    out = []
    for run, start in zip(data.grid, data.starts, strict=True):
        up, down = (replace(start, initial_soc=start.initial_soc + sign * _MOVED) for sign in (1.0, -1.0))
        out.append((free_run_from_V(network, run, up) - free_run_from_V(network, run, down)) / (2.0 * _MOVED))
    return out
