"""The sums of products that a bounded network is solved from, fold by fold, and its penalties."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from models.data.timeseries import FloatArray
from models.identification.bounded.knots import hats
from models.identification.bounded.layout import REFERENCE_DEGC, Layout, counted, soc_over
from models.identification.bounded.terms import Basis
from models.network.folds import N_FOLDS, balanced_groups, group_numbers
from models.network.regression import SignalBank

_BLOCK = 8192
# A direction that flows less than this share of the other is held as if it flowed so much. With 0.1 a network of
# charges at 1.5 A was 0.56 V off in discharges at 4 A (0.37 V with this). With 1, of ten splits of measured records
# three were worse than with this by more than a tenth, and two better.
_LEAST_SHARE = 0.3
# A cell under load drifts by a kelvin or two, slowly, as do other errors of a model, and these would be put down to the
# curve's change with temperature: it is believed as far as the temperature varied by more than this beside all else.
_WARMTH_K = 0.3
# In a rest so many samples a second tell all there is to tell, half as many after so many seconds of it.
_REST_HZ, _REST_S = 1.0, 60.0


@dataclass(frozen=True)
class Sums:
    """Sums of products of each fold; curve by its values.

    Attributes
    ----------
    layout : of the coefficients
    xx : (folds, P, P), xy : (folds, P), yy : (folds,)
    count : (folds,) samples, or what they weigh
    penalties : (5, P, P) forms in V^2: bend of the curve, differences of gains, their size, those of the temperature's,
        and the curve's change over `_WARMTH_K`
    """

    layout: Layout
    xx: FloatArray
    xy: FloatArray
    yy: FloatArray
    count: FloatArray
    penalties: FloatArray

    def by_increments(self) -> Sums:
        """The same with the curve given by its first value and its increments, so that bounds are on coefficients."""
        n = self.layout.n_curve

        def turned(matrix: FloatArray) -> FloatArray:
            out = matrix.copy()
            out[..., :n, :] = summed_beyond(out[..., :n, :], axis=-2)
            out[..., :, :n] = summed_beyond(out[..., :, :n])
            return out

        xy = self.xy.copy()
        xy[:, :n] = summed_beyond(xy[:, :n])
        return Sums(self.layout, turned(self.xx), xy, self.yy, self.count, turned(self.penalties))


def summed_beyond(values: FloatArray, axis: int = -1) -> FloatArray:
    """Derivatives by a curve's first value and its increments, from those by its values; shape as `values`.

    With a curve of cumulated increments, the derivative by an increment is the sum over all later knots.

    Parameters
    ----------
    values : derivatives by the values at the knots
    axis : along which the knots stand
    """
    return np.flip(np.cumsum(np.flip(values, axis), axis=axis), axis)


def rest_weights(bank: SignalBank) -> FloatArray:
    """(N,) what each sample of all runs weighs: in a rest the less, the longer it has lasted.

    Seconds of a rest say what those before them said, and an hour of it, taken at its 3600 samples, outweighs the
    pulse before it. What relaxes is told by as many samples in each decade of time, that is by a rate that falls as
    1 / (1 + t / `_REST_S`). Samples that come more often share what they weigh; one a minute weighs as much as under
    load for the first hour.
    """
    out = []
    for run in bank.runs:
        resting, number = np.abs(run.current_A) <= bank.cell.rest_A, np.arange(len(run))
        last = np.maximum.accumulate(np.where(resting, -1, number))
        before = np.concatenate([[-1], np.maximum.accumulate(np.where(run.measured, number, -1))[:-1]])
        rested_s = np.where(resting, (number - last) * run.dt_s, 0.0)
        needed_Hz = np.maximum(_REST_HZ, 1.0 / run.dt_s) / (1.0 + rested_s / _REST_S)
        out.append(np.minimum((number - before) * run.dt_s * needed_Hz, 1.0))
    return np.concatenate(out)


def make_sums(
    bank: SignalBank,
    layout: Layout,
    keep_every: int = 1,
    fold: np.ndarray | None = None,
    weight: FloatArray | None = None,
) -> Sums:
    """Sums of products over all samples with a measured voltage.

    Parameters
    ----------
    bank : signals of the runs
    layout : of the coefficients
    keep_every : every n-th sample is counted
    fold : (N,) number of the fold of each sample of all runs; by default as `folds` has them
    weight : (N,) of each sample of all runs; by default all weigh the same
    """
    voltage = np.concatenate([run.voltage_V for run in bank.runs])
    own = fold_of(bank) if fold is None else fold
    n_folds, size = int(own.max()) + 1, layout.size
    chosen = counted(voltage, keep_every)
    rows = regressors(bank, layout.basis, layout.scale, chosen)
    soc = np.concatenate(soc_over(bank, layout.basis.axis))[chosen]
    voltage, own = voltage[chosen], own[chosen]
    heavy = None if weight is None else weight[chosen]
    xx, xy = np.zeros((n_folds, size, size)), np.zeros((n_folds, size))
    yy, count = np.zeros(n_folds), np.zeros(n_folds)
    for fold_number in range(n_folds):
        for part, block, columns in blocks(layout, rows, soc, np.flatnonzero(own == fold_number)):
            y = voltage[part]
            if heavy is not None:
                root = np.sqrt(heavy[part])
                y, block = root * y, root[:, None] * block
            xx[fold_number][np.ix_(columns, columns)] += block.T @ block
            xy[fold_number][columns] += block.T @ y
            yy[fold_number] += y @ y
            count[fold_number] += len(y) if heavy is None else float(heavy[part].sum())
    rms = [
        max(_rms(rows[:, b], heavy), _LEAST_SHARE * _mirrored_rms(bank, layout, b))
        for b in range(len(layout.basis.terms))
    ]
    return Sums(layout, xx, xy, yy, count, penalty_forms(layout, np.array(rms)))


def _mirrored_rms(bank: SignalBank, layout: Layout, term: int) -> float:
    """RMS of a term's counterpart in its scale; 0 where it is its own."""
    it = layout.basis.terms[term]
    if it.mirrored == it.signal:
        return 0.0
    return _rms(np.concatenate(bank.values(it.mirrored))) / float(layout.scale[term])


def _rms(values: FloatArray, weight: FloatArray | None = None) -> float:
    return float(np.sqrt(np.average(values**2, weights=weight)))


def fold_of(bank: SignalBank) -> np.ndarray:
    """(N,) number of the fold that holds out each sample of all runs."""
    return groups_of(bank) % N_FOLDS


def groups_of(bank: SignalBank) -> np.ndarray:
    """(N,) number of the group that each sample of all runs is held out with."""
    measured = np.concatenate([run.measured for run in bank.runs])
    return group_numbers(run_index(bank), balanced_groups(bank.runs), measured)


def run_index(bank: SignalBank) -> np.ndarray:
    """(N,) which run each sample belongs to."""
    return np.repeat(np.arange(len(bank.runs)), [len(run) for run in bank.runs])


def regressors(bank: SignalBank, basis: Basis, scale: FloatArray, chosen: np.ndarray | None = None) -> FloatArray:
    """(N, B) signals of the terms over their largest values, of the samples of all runs or of some."""
    index = np.arange(sum(len(run) for run in bank.runs)) if chosen is None else chosen
    out = np.empty((len(index), len(basis.terms)))
    for b, (term, largest) in enumerate(zip(basis.terms, scale, strict=True)):
        values = np.concatenate(bank.values(term.signal))[index]
        out[:, b] = (values - (0.0 if term.bounded else REFERENCE_DEGC)) / largest
    return out


def blocks(
    layout: Layout, rows: FloatArray, soc: FloatArray, chosen: np.ndarray
) -> Iterator[tuple[np.ndarray, FloatArray, np.ndarray]]:
    """Samples between the same two knots of the gains together: which, their regressors, and of which coefficients.

    Parameters
    ----------
    layout : of the coefficients
    rows : (N, B) signals of the terms over their largest values
    soc : (N,) on the partition axis
    chosen : samples to go through
    """
    inner = layout.knots.soc[layout.knots.gain]
    cell = np.clip(np.searchsorted(inner, soc[chosen], side="right") - 1, 0, len(inner) - 2)
    for at in np.unique(cell):
        own = chosen[cell == at]
        for start in range(0, len(own), _BLOCK):
            part = own[start : start + _BLOCK]
            block, columns = _block(layout, int(at), rows[part], soc[part])
            yield part, block, columns


def _block(layout: Layout, cell: int, rows: FloatArray, soc: FloatArray) -> tuple[FloatArray, np.ndarray]:
    """Regressors of samples between two neighbouring knots of the gains, and which coefficients they belong to."""
    knots = layout.knots
    low, high = int(knots.gain[cell]), int(knots.gain[cell + 1])
    curve = hats(knots.soc[low : high + 1], soc)
    pair = hats(knots.soc[[low, high]], soc)
    gains = np.array([b for b, t in enumerate(layout.basis.terms) if t.bounded and not t.flat], dtype=np.int64)
    parts = [curve, rows[:, gains] * pair[:, :1], rows[:, gains] * pair[:, 1:]]
    columns = [np.arange(low, high + 1), layout.first[gains] + cell, layout.first[gains] + cell + 1]
    for b, term in enumerate(layout.basis.terms):
        if not term.bounded or term.flat:
            parts.append(rows[:, b : b + 1] * hats(knots.soc[layout.places(b)], soc))
            columns.append(np.arange(layout.first[b], layout.first[b + 1]))
    return np.hstack(parts), np.concatenate(columns)


def penalty_forms(layout: Layout, rms: FloatArray) -> FloatArray:
    """(5, P, P) forms in V^2, each a mean over knots and, of gains, of the voltage that they stand for."""
    size, n = layout.size, layout.n_curve
    forms = np.zeros((5, size, size))
    bend = np.diff(np.eye(n), 2, axis=0)
    forms[0, :n, :n] = bend.T @ bend / len(bend)
    for b, term in enumerate(layout.basis.terms):
        part = slice(int(layout.first[b]), int(layout.first[b + 1]))
        count = part.stop - part.start
        steps = np.diff(np.eye(count), axis=0)
        differences = rms[b] ** 2 * steps.T @ steps / max(len(steps), 1)
        if term.bounded:
            forms[1, part, part] = differences
            forms[2, part, part] = term.held * rms[b] ** 2 * np.eye(count) / count
        else:
            forms[3, part, part] = differences + 1e-2 * rms[b] ** 2 * np.eye(count) / count
            forms[4, part, part] = (_WARMTH_K / layout.scale[b]) ** 2 * np.eye(count) / count
    return forms
