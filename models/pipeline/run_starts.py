"""Where the training runs begin, found together with the model that is fitted to them.

A run that begins in a relaxation or on the other branch of a hysteresis loop, taken for one at rest, bends the model;
so does a state of charge that somebody only believed. A first model shows which runs those are. It is fitted again with
what flowed before in front of them and with corrected states of charge, and what explains the runs clearly better
stays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from models.comparison.start import Start, free_run_from_V, put_in_front
from models.comparison.start_fit import plainly_not_at_rest, start_from_run
from models.comparison.start_noise import ErrorModel, seen_error_model
from models.data.history import PlacedRun
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.training import Training

_ROUNDS, _ROUNDS_WITH_SOC = 2, 6
# A model follows the states of charge that it is fitted to, so that each round finds a share of what is left only. From
# two rounds the sum of all is told, up to this share.
_LARGEST_SHARE_LEFT = 0.8
# By how much a new round must lower the training error (RMS): less is what five more numbers a run bring by chance.
_WORTH = 0.01

BuiltT = TypeVar("BuiltT")


def with_starts(
    data: Training,
    built: BuiltT,
    build: Callable[[Training], BuiltT],
    network_of: Callable[[BuiltT], LocalModelNetwork],
    soc_std: float = 0.0,
) -> tuple[Training, BuiltT]:
    """Find where the training runs begin, and fit again from there.

    Parameters
    ----------
    data : with the stated starts
    built : what was fitted to them
    build : fits the same choices to data with other starts
    network_of : the network in what was fitted
    soc_std : how far off a stated state of charge may be; 0: it is known, and only a start that is plainly not at rest
        is moved

    Returns
    -------
    data, built
        As they were, but for standard deviations, where other starts do not explain the runs clearly better.
    """
    stated = [Start(start.initial_soc, soc_std or None) for start in data.starts]
    stated_soc = np.array([said.initial_soc for said in stated])
    rounds: list[FloatArray] = []
    for number in range(_ROUNDS_WITH_SOC if soc_std > 0.0 else _ROUNDS):
        network = network_of(built)
        errors_V = _errors_V(network, data)
        # What a wrong start does has mostly died out in the second half of a run.
        expected = seen_error_model([each[len(each) // 2 :] for each in errors_V])
        found = _found(network, data, stated, expected, number == 0)
        if not any(_moved(new, old) for new, old in zip(found, data.starts, strict=True)):
            break
        rounds.append(np.array([new.initial_soc - said.initial_soc for new, said in zip(found, stated, strict=True)]))
        if number % 2 and soc_std > 0.0:
            ahead = stated_soc + _extrapolated(rounds[-2], rounds[-1])
            found = [replace(new, initial_soc=float(soc)) for new, soc in zip(found, ahead, strict=True)]
        placed = _placed(network, data, found)
        trial = build(placed)
        if not _rms_V(_errors_V(network_of(trial), placed)) < (1.0 - _WORTH) * _rms_V(errors_V):
            break
        data, built = placed, trial
    return (data, built) if soc_std == 0.0 else (_with_std(network_of(built), data, soc_std), built)


def _found(
    network: LocalModelNetwork, data: Training, stated: list[Start], expected: ErrorModel, first: bool
) -> list[Start]:
    """Starts that a network shows; where the state of charge is known, only of runs that plainly need another."""
    out = []
    for run, said, now in zip(data.grid, stated, data.starts, strict=True):
        asked = said.soc_std is not None or now.history is not None
        asked = asked or (first and plainly_not_at_rest(network, run, said, expected))
        out.append(start_from_run(network, run, said, expected, said.soc_std is not None) if asked else now)
    return out


def _extrapolated(before: FloatArray, now: FloatArray) -> FloatArray:
    """Where rounds that each find the same share of what is left would end (Aitken)."""
    last = now - before
    share = float(np.clip(last @ before / max(float(before @ before), 1e-12), 0.0, _LARGEST_SHARE_LEFT))
    return before + last / (1.0 - share)


def _moved(new: Start, old: Start) -> bool:
    return new.history != old.history or new.initial_soc != old.initial_soc


def _placed(network: LocalModelNetwork, data: Training, starts: list[Start]) -> Training:
    """Training data with other starts and what flowed before in front."""
    fronts = [put_in_front(network, run, start) for run, start in zip(data.grid, starts, strict=True)]
    grid = [_initialised(network, front) for front in fronts]
    return replace(data, starts=starts, fit_grid=grid, fit_soc=[front.initial_soc for front in fronts])


def _initialised(network: LocalModelNetwork, front: PlacedRun) -> GridRun:
    """With the initial values that a network with past outputs needs at the first samples, which count nowhere else."""
    order = network.structure.output_order
    if front.n_before <= order:
        return front.run
    voltage_V = front.run.voltage_V.copy()
    voltage_V[:order] = free_run_from_V(network, front.run, Start(front.initial_soc))[:order]
    return replace(front.run, voltage_V=voltage_V)


def _errors_V(network: LocalModelNetwork, data: Training) -> list[FloatArray]:
    return [
        run.voltage_V - free_run_from_V(network, run, start) for run, start in zip(data.grid, data.starts, strict=True)
    ]


def _rms_V(errors_V: list[FloatArray]) -> float:
    return float(np.sqrt(np.nanmean(np.concatenate(errors_V) ** 2)))


def _with_std(network: LocalModelNetwork, data: Training, soc_std: float) -> Training:
    """With the standard deviation of each state of charge.

    A shift that all runs share moves the model's open-circuit curve along and shows nowhere: it stays as uncertain as
    the mean of what was said.
    """
    shared = soc_std / np.sqrt(len(data.grid))
    out = []
    for run, start in zip(data.grid, data.starts, strict=True):
        known = start
        if start.soc_std is None:
            known = start_from_run(network, run, replace(start, soc_std=soc_std, history=None))
        apart = known.initial_soc - start.initial_soc
        std = float(np.sqrt((known.soc_std or 0.0) ** 2 + apart**2 + shared**2))
        out.append(replace(start, soc_std=min(std, soc_std)))
    return replace(data, starts=out)
