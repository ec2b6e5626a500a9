"""The constants of a structure's signals, moved together until the held-out error is least.

Time constants, activations, exchange current, diffusion and hysteresis rate stand in for each other: moved one at a
time they stop where each is wrong and another makes up for it. The voltage is then simulated nearly as well, but
resistance is shared out wrongly between them. Gauss-Newton on the held-out errors moves them along such valleys. The
parameters of the local models are fitted anew at every step, so that only the constants are searched (variable
projection, Golub and Pereyra 1973).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.identification.search.auto import AutoCandidate
from models.identification.search.samples import KeptSamples
from models.identification.shared_poles import solve_without
from models.network.partition import Partition

Residual = Callable[[AutoCandidate], FloatArray | None]

# Field (and place in it) -> smallest and largest value.
_BOUNDS: dict[str, tuple[float, float]] = {
    "time_constants_s": (1.0, 6000.0),
    "activation_K": (300.0, 12000.0),
    "second_activation_K": (300.0, 12000.0),
    "exchange_c_rate": (0.005, 20.0),
    "surface/0": (0.002, 0.3),
    "surface/1": (20.0, 10000.0),
    "surface/2": (300.0, 12000.0),
    "squared/0": (2.0, 1000.0),
    "squared/1": (300.0, 12000.0),
    "hysteresis_rates": (3.0, 300.0),
}
_PROBE = 0.03
_LARGEST_STEP = 0.4
_SHARES = (1.0, 0.4, 0.1)
_DAMPING = 1e-3
_MOST_STEPS = 10
# Share of the squared error at the start that a move by a factor of e must be worth: what the runs hardly show stays.
_PRICE = 0.003
# A step that lowers the squared error by less than this share is the last.
_WORTH = 0.0005


def held_out_errors(
    kept: KeptSamples, partition: Partition, forms: list[FloatArray], strengths: Sequence[float]
) -> FloatArray:
    """(m,) normalised errors of samples by parameters that their fold had no part in; 0 where none is counted.

    Parameters
    ----------
    kept : samples of a structure without past outputs
    partition : boxes
    forms : penalties
    strengths : their powers of ten
    """
    sums, validity = kept.moments(partition), partition.validity(kept.data.z)
    weighted = [10.0**s * form for s, form in zip(strengths, forms, strict=True)]
    penalty = np.add.reduce(weighted) * float(sums.count.sum())
    out = np.zeros(len(kept.target))
    for fold in range(len(sums.count)):
        b = solve_without(sums, penalty, np.array([fold])).reshape(partition.n_models, -1)
        k = np.flatnonzero(kept.fold == fold)
        out[k] = kept.target[k] - np.einsum("kp,kp->k", validity[k] @ b, kept.inputs[k])
    return np.nan_to_num(out)


def constants(candidate: AutoCandidate) -> dict[tuple[str, int], float]:
    """Return the constants of a candidate that can be moved: (field, place; -1: the field itself) -> value."""
    found: dict[tuple[str, int], float] = {}
    for key in _BOUNDS:
        name, _, place = key.partition("/")
        value = getattr(candidate, name)
        if isinstance(value, tuple):
            places = [int(place)] if place else range(len(value))
            found |= {(name, i): value[i] for i in places if value[i]}
        elif value:
            found[name, -1] = value
    return found


def with_constants(candidate: AutoCandidate, values: dict[tuple[str, int], float]) -> AutoCandidate:
    """Return the candidate with other constants, each to four digits and within its bounds."""
    changed: dict[str, float | tuple[float, ...]] = {}
    for (name, place), value in values.items():
        low, high = _BOUNDS.get(f"{name}/{place}") or _BOUNDS[name]
        rounded = float(f"{min(max(value, low), high):.4g}")
        if place < 0:
            changed[name] = rounded
        else:
            before = changed.get(name, getattr(candidate, name))
            assert isinstance(before, tuple)
            changed[name] = (*before[:place], rounded, *before[place + 1 :])
    return replace(candidate, **changed)


def moved(candidate: AutoCandidate, residual: Residual) -> AutoCandidate:
    """Candidate with its constants where the held-out error is least.

    Parameters
    ----------
    candidate : where to begin
    residual : held-out errors of a candidate, always of the same samples; None: that candidate must not be used
    """
    first = residual(candidate)
    if first is None:
        return candidate
    start = constants(candidate)
    scale = np.sqrt(_PRICE * float(first @ first))

    def priced(there: AutoCandidate) -> FloatArray | None:
        errors, values = residual(there), constants(there)
        away = [scale * float(np.log(values.get(key, value) / value)) for key, value in start.items()]
        return None if errors is None else np.concatenate([errors, away])

    best, error = candidate, np.concatenate([first, np.zeros(len(start))])
    for _ in range(_MOST_STEPS):
        found = _step(best, error, priced)
        if found is None:
            break
        gain = 1.0 - float(found[1] @ found[1]) / float(error @ error)
        best, error = found
        if gain < _WORTH:
            break
    return best


def _step(best: AutoCandidate, error: FloatArray, residual: Residual) -> tuple[AutoCandidate, FloatArray] | None:
    """One step along all constants; None where no share of it lowers the error."""
    start = constants(best)
    keys, columns = [], []
    for key, value in start.items():
        probed = _probed(best, key, value, error, residual)
        if probed is not None:
            keys.append(key)
            columns.append(probed)
    if not keys:
        return None
    jacobian = np.column_stack(columns)
    information = jacobian.T @ jacobian
    damped = information + _DAMPING * np.diag(np.diag(information)) + 1e-12 * np.trace(information) * np.eye(len(keys))
    step = np.clip(-np.linalg.solve(damped, jacobian.T @ error), -_LARGEST_STEP, _LARGEST_STEP)
    for share in _SHARES:
        moves = {key: start[key] * float(np.exp(share * s)) for key, s in zip(keys, step, strict=True)}
        trial = with_constants(best, moves)
        error_there = residual(trial)
        if error_there is not None and error_there @ error_there < error @ error:
            return trial, error_there
    return None


def _probed(
    best: AutoCandidate, key: tuple[str, int], value: float, error: FloatArray, residual: Residual
) -> FloatArray | None:
    """Derivative of the errors to a constant's logarithm; None where it cannot be moved."""
    for sign in (1.0, -1.0):
        there = with_constants(best, {key: value * float(np.exp(sign * _PROBE))})
        beside = None if there == best else residual(there)
        if beside is not None:
            return sign * (beside - error) / _PROBE
    return None
