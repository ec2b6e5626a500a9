"""Where the training runs begin, found together with the model that is fitted to them.

A run that begins in a relaxation or on the other branch of a hysteresis loop, taken for one at rest, bends the model;
so does a state of charge that somebody only believed. A first model shows which runs those are. It is fitted again with
what flowed before in front of them and with corrected states of charge, and what explains the runs clearly better
stays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from models.comparison.start import Start, free_run_from_V, put_in_front
from models.comparison.start_fit import plainly_not_at_rest, start_from_run
from models.comparison.start_noise import ErrorModel, seen_error_model, whitener
from models.data.errors import ModelError
from models.data.history import PlacedRun
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis import likely_soc
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import SignalBank
from models.pipeline.joint_soc import joint_soc, meeting, within
from models.pipeline.plans import Built
from models.pipeline.training import Training

_ROUNDS = 4
# By how much each round must raise twice the log-likelihood of the training error, for each run whose start it moves:
# the 0.1 % level of chi-square for the six numbers of a start. A round that lowers the error by little is the last.
_WORTH, _LITTLE = 22.5, 0.002
# What other starts leave of unseen samples, over what those that are known leave: runs of simulated cells (in class),
# cut at random, had 0.38 to 0.83 of it; four runs of a measured cell that were better left alone had 0.87. A log that
# begins at rest and is wrong at first for another cause may explain its training runs a little better from elsewhere.
_UNSEEN_WORTH = 0.85
# A start is looked for where the error over so long is so many times that of the rest of the run. Runs of a real cell
# that began at rest were at most 2.1 times worse, cut ones of a simulated cell 4 to 8 times.
_FIRST_S, _WORSE = 600.0, 2.5
# States of charge are moved along straight pieces of the curve by no more than this at once.
_STRAIGHT_SOC = 0.01


def with_starts(
    data: Training, built: Built, build: Callable[[Training], Built], soc_std: float = 0.0
) -> tuple[Training, Built]:
    """Find where the training runs begin, and fit again from there.

    Parameters
    ----------
    data : with the stated starts
    built : what was fitted to them
    build : fits the same choices to data with other starts
    soc_std : how far off a stated state of charge may be; 0: it is known, and only a start that is plainly not at rest
        is moved

    Returns
    -------
    data, built
        As they were, but for standard deviations, where other starts do not explain the runs clearly better.
    """
    found = _in_rounds(data, built, build, soc_std)
    if soc_std > 0.0:
        return found
    # A fit that took each run for one at rest may have bent itself until it explains what it saw as well. Wrong starts
    # have not bent what the runs say whatever flowed before them.
    unbent = built.with_open_starts()
    if unbent is built.network:
        return found
    trial = _placed(unbent, data, _histories(unbent, data, _errors_V(unbent, data)))
    if trial.starts == data.starts:
        return found
    again = build(trial)
    return _in_rounds(trial, again, build, soc_std) if _is_worth(found[1], again) else found


def _in_rounds(
    data: Training, built: Built, build: Callable[[Training], Built], soc_std: float
) -> tuple[Training, Built]:
    """Training data and what is fitted to them, from starts that the fit before has found."""
    stated = data.soc
    for number in range(_ROUNDS):
        network = built.network
        errors_V = _errors_V(network, data)
        trial = data
        # A wrong state of charge would pass for a history: it is put right first.
        if number > 0 or soc_std == 0.0:
            trial = _placed(network, trial, _histories(network, trial, errors_V))
        if soc_std > 0.0:
            soc, _ = joint_soc(network, trial, stated, soc_std)
            starts = [replace(start, initial_soc=float(each)) for start, each in zip(trial.starts, soc, strict=True)]
            trial = _placed(network, trial, starts)
        if trial.starts == data.starts:
            break
        again = build(trial)
        again_V = _errors_V(again.network, trial)
        moved = sum(new != old for new, old in zip(trial.starts, data.starts, strict=True))
        if _gain(errors_V, again_V) > _WORTH * moved and _rms_V(again_V) < _rms_V(errors_V):
            data, built = trial, again
        elif number > 0 or soc_std == 0.0:
            break
        if number > 0 and _rms_V(again_V) > (1.0 - _LITTLE) * _rms_V(errors_V):
            break
    return (data, built) if soc_std == 0.0 else (_with_std(built.network, data, stated, soc_std), built)


def _is_worth(known: Built, found: Built) -> bool:
    """Whether other starts leave clearly less of unseen samples: of blocks in time, and of whole runs."""
    before, after = ([each.held_out_blocks().rmse_V, each.held_out().rmse_V] for each in (known, found))
    return all(new <= _UNSEEN_WORTH * old for old, new in zip(before, after, strict=True))


def likely_starts(data: Training, network: LocalModelNetwork, soc_std: float) -> Training | None:
    """Training data with states of charge that contradict each other least, whatever flowed before the runs.

    Parameters
    ----------
    data : with the starts that are known so far
    network : fitted to them
    soc_std : how far off a state of charge may be

    Returns
    -------
    Training or None
        None where the runs cannot tell: a single one, or such as do not meet.
    """
    meets = meeting(data)
    if meets.sum() <= 1:
        return None
    bank = SignalBank(data.fit_grid, data.fit_soc, data.cell)
    try:
        shift, std = likely_soc(bank, min(soc_std, _STRAIGHT_SOC))
    except (ModelError, np.linalg.LinAlgError):
        # What cannot carry a diagnosis cannot tell either where its runs begin: they stay as stated.
        return None
    # One that all share moves the curve along and shows nowhere.
    now = np.array(data.soc)
    soc = within(np.where(meets, now + shift - shift[meets].mean(), now), now)
    whole = np.where(meets, np.minimum(np.hypot(std, soc_std / np.sqrt(meets.sum())), soc_std), soc_std)
    starts = [
        replace(start, initial_soc=float(each), soc_std=float(own))
        for start, each, own in zip(data.starts, soc, whole, strict=True)
    ]
    return _placed(network, data, starts)


def _histories(network: LocalModelNetwork, data: Training, errors_V: list[FloatArray]) -> list[Start]:
    """Starts with what flowed before, of runs that plainly need it."""
    # What a wrong start does has mostly died out in the second half of a run.
    expected: ErrorModel = seen_error_model([each[len(each) // 2 :] for each in errors_V])
    out = []
    for run, now, error_V in zip(data.grid, data.starts, errors_V, strict=True):
        rest = replace(now, history=None)
        suspect = _is_worse_at_first(error_V, run.dt_s) and plainly_not_at_rest(network, run, rest, expected)
        asked = now.history is not None or suspect
        out.append(start_from_run(network, run, rest, expected) if asked else now)
    return out


def _is_worse_at_first(error_V: FloatArray, dt_s: float) -> bool:
    """Whether the first ten minutes are much worse than the rest, as they are where a run does not begin at rest."""
    first = 1 + int(_FIRST_S / dt_s)
    if not (np.isfinite(error_V[:first]).any() and np.isfinite(error_V[first:]).any()):
        return False
    return bool(np.nanmean(error_V[:first] ** 2) > _WORSE**2 * np.nanmean(error_V[first:] ** 2))


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


def _gain(before_V: list[FloatArray], after_V: list[FloatArray]) -> float:
    """By how much twice the log-likelihood rose, errors being such as those after."""
    expected = seen_error_model(after_V)
    gain = 0.0
    for before, after in zip(before_V, after_V, strict=True):
        white = whitener(np.isfinite(after), expected)
        gain += float(np.sum(white.white(before) ** 2) - np.sum(white.white(after) ** 2))
    return gain


def _rms_V(errors_V: list[FloatArray]) -> float:
    return float(np.sqrt(np.nanmean(np.concatenate(errors_V) ** 2)))


def _with_std(network: LocalModelNetwork, data: Training, stated: list[float], soc_std: float) -> Training:
    """With the standard deviation of each state of charge; one more step that was not worth taking counts as one."""
    soc, std = joint_soc(network, data, stated, soc_std)
    away = soc - np.array(data.soc)
    whole = np.minimum(np.hypot(std, away), soc_std)
    return replace(data, starts=[replace(s, soc_std=float(w)) for s, w in zip(data.starts, whole, strict=True)])
