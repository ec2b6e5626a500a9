"""Groups of training samples that are held out together when choices are judged."""

from __future__ import annotations

import numpy as np

from models.data.resampling import GridRun

N_FOLDS = 5
# From so many runs on, kinds of models are compared on whole ones.
WHOLE_RUNS = 3
_GROUPS = 20


def group_numbers(
    run_index: np.ndarray, run_group: np.ndarray | None, measured: np.ndarray | None = None
) -> np.ndarray:
    """(N,) number of the group that each sample belongs to.

    Whole runs where there are at least as many as folds; else each run in blocks in time, long enough that a block
    spans operating points which the rest of its fold has not seen. The free run passes through held-out samples, so
    the error there is one of simulation, not of prediction from measured voltage. Blocks are numbered so that each run
    gives each fold as many, and another part in each run: runs often pass the same states of charge at the same share
    of their time, and a fold that took the same part of each would have to extrapolate.

    Parameters
    ----------
    run_index : (N,) which run a sample belongs to
    run_group : (runs,) in which group each run is held out; None: each in that of its own number
    measured : (N,) whether a sample has a voltage; blocks have equally many of these: what flowed before a run, put in
        front of it, is nothing that could be held out
    """
    n_runs = int(run_index.max()) + 1
    if n_runs >= N_FOLDS:
        own = np.arange(n_runs) if run_group is None else run_group
        return own[run_index].astype(np.int64)
    blocks = N_FOLDS * -(-_GROUPS // (N_FOLDS * n_runs))
    out = np.empty(len(run_index), dtype=np.int64)
    for run in range(n_runs):
        index = np.flatnonzero(run_index == run)
        counted = np.ones(len(index), dtype=np.int64) if measured is None else measured[index].astype(np.int64)
        place = np.cumsum(counted) - counted
        block = np.minimum(place * blocks // max(int(counted.sum()), 1), blocks - 1)
        out[index] = run * blocks + (block + run) % blocks
    return out


def outer_folds(run_index: np.ndarray, group: np.ndarray) -> np.ndarray:
    """(N,) number of the fold in which kinds of models are compared: whole runs wherever there are at least three.

    Parameters
    ----------
    run_index : (N,) which run a sample belongs to
    group : (N,) number of the group that each sample is held out with
    """
    n_runs = int(run_index.max()) + 1
    return run_index if WHOLE_RUNS <= n_runs < N_FOLDS else group % N_FOLDS


def balanced_groups(runs: list[GridRun]) -> np.ndarray:
    """(runs,) number of the group of each run, so that every fold holds out runs at every temperature.

    Runs of like temperature stand together, and in each such set the fold goes by load: one fold holds out the
    gentlest runs of all temperatures, another the hardest, on which a model has to extrapolate. The order in which
    the runs were given does not matter.
    """
    temperature = [float(np.nan_to_num(np.mean(run.temperature_degC))) for run in runs]
    load_A = [float(np.mean(np.abs(run.current_A))) for run in runs]
    by_temperature = sorted(range(len(runs)), key=lambda i: (temperature[i], load_A[i]))
    out = np.empty(len(runs), dtype=np.int64)
    for first in range(0, len(runs), N_FOLDS):
        members = sorted(by_temperature[first : first + N_FOLDS], key=lambda i: load_A[i])
        out[members] = first + np.arange(len(members))
    return out


def folds(n_groups: int) -> list[np.ndarray]:
    """Numbers of the groups that each fold holds out."""
    every = np.arange(n_groups)
    return [every[every % N_FOLDS == fold] for fold in range(min(N_FOLDS, n_groups))]
