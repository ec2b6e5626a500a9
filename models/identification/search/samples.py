"""The samples on which candidates of a structure search are compared: few, but filtered as if all were there.

A shared pole p turns Phi_i u_j into x(k) = p x(k-1) + Phi_i(k) u_j(k). Between two samples that are kept, g apart, the
validity hardly changes, and with v the input alone after the same filter x(k) = p^g x(k-g) + Phi_i(k) (v(k) - p^g
v(k-g)). Where a partition variable jumps, as the held sign of the current does, the sample before is kept too, so that
no validity is held across. Two poles are a sum of two such filters (partial fractions).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numba import njit

from models.data.timeseries import FloatArray
from models.identification.shared_poles import Moments, initial_response, output_coefficients
from models.network.folds import N_FOLDS, balanced_groups, group_numbers
from models.network.partition import Partition
from models.network.recursion import samples_since_start
from models.network.regression import VOLTAGE, Dataset, SignalBank, axis_lag, delayed, normalise
from models.network.structure import Structure

_BLOCK = 1024
# A partition variable that moves by more than this share of its range from one sample to the next has jumped.
_JUMP = 0.1
# Time constants closer together than this ratio are told apart by it: partial fractions need distinct poles.
_LEAST_RATIO = 1.05


@dataclass(frozen=True)
class KeptSamples:
    """What one candidate is judged on.

    Attributes
    ----------
    data : m samples, inputs not filtered
    target : (m,) outputs less what the measured initial values bring; NaN where a sample is not counted
    inputs : (m, q) inputs after the common filter
    steps : (n_filters, m, q) what each sample adds to each filter's state for a validity of 1
    decay : (n_filters, m) what is left of the state of the sample before
    fold : (m,) which fold holds the sample out
    """

    data: Dataset
    target: FloatArray
    inputs: FloatArray
    steps: FloatArray
    decay: FloatArray
    fold: np.ndarray

    def moments(self, partition: Partition) -> Moments:
        """Moments of each fold."""
        validity = partition.validity(self.data.z)
        size, n_folds = partition.n_models * self.data.u.shape[1], int(self.fold.max()) + 1
        xx, xy = np.zeros((n_folds, size, size)), np.zeros((n_folds, size))
        yy, count = np.zeros(n_folds), np.zeros(n_folds)
        carry, block = np.zeros((len(self.steps), size)), np.empty((_BLOCK, size))
        usable = ~np.isnan(self.target)
        cuts = np.flatnonzero(np.diff(self.fold)) + 1
        for first, end in zip([0, *cuts], [*cuts, len(usable)], strict=True):
            fold = self.fold[first]
            for begin in range(first, end, _BLOCK):
                part = slice(begin, min(begin + _BLOCK, end))
                rows = block[: part.stop - part.start]
                _filtered_rows(begin, validity, self.steps, self.decay, carry, rows)
                chosen = usable[part]
                x, y = rows if chosen.all() else rows[chosen], self.target[part][chosen]
                xx[fold] += x.T @ x
                xy[fold] += x.T @ y
                yy[fold] += y @ y
                count[fold] += len(y)
        return Moments(xx, xy, yy, count)


@dataclass(frozen=True)
class SampleBank:
    """Samples of several runs, each column made once however many candidates ask for it.

    Attributes
    ----------
    bank : signals of the runs
    keep_every : every n-th sample is counted
    """

    bank: SignalBank
    keep_every: int
    _columns: dict[tuple[object, ...], FloatArray] = field(default_factory=dict)
    _indices: dict[tuple[str, ...], np.ndarray] = field(default_factory=dict)

    def take(self, structure: Structure, time_constants_s: tuple[float, ...]) -> KeptSamples:
        """Samples for a structure whose local models share poles of these time constants."""
        axes = tuple(axis.signal for axis in structure.axes) if structure.output_order else ()
        index, poles = self._index(axes), _poles(time_constants_s, structure.dt_s)
        taps = structure.taps()
        u = np.column_stack([*(self._column(axes, *tap) for tap in taps), np.ones(len(index))])
        z = np.column_stack([self._column(axes, a.signal, axis_lag(a.signal)) for a in structure.axes])
        y = self._voltage[index]
        data = Dataset(u, z, y, self._starts, self._run_index[index])
        uncounted = (index - self._first[self._run_index[index]]) % self.keep_every != 0
        if not poles:
            target = np.where(uncounted, np.nan, y)
            return KeptSamples(data, target, u, u[None], np.zeros((1, len(u))), self._fold[index])
        a, since = output_coefficients(time_constants_s, structure.dt_s), self._since
        target = y - initial_response(np.nan_to_num(self._voltage), a, since)[index]
        target[uncounted | (since[index] < len(poles))] = np.nan
        gap, apart = np.diff(index, prepend=0), np.diff(self._part[index], prepend=-1) != 0
        residues = [np.prod([p / (p - other) for other in poles if other != p]) for p in poles]
        names: list[tuple[str, int]] = [*taps, ("", 0)]
        inputs, steps, decay = np.zeros_like(u), np.empty((len(poles), *u.shape)), np.empty((len(poles), len(u)))
        for at, (pole, residue) in enumerate(zip(poles, residues, strict=True)):
            after = residue * np.column_stack([self._column(axes, *tap, pole, len(poles)) for tap in names])
            decay[at] = np.where(apart, 0.0, pole**gap)
            steps[at] = after
            steps[at, 1:] -= decay[at, 1:, None] * after[:-1]
            inputs += after
        return KeptSamples(data, target, inputs, steps, decay, self._fold[index])

    def _column(self, axes: tuple[str, ...], name: str, lag: int, pole: float = 0.0, order: int = 0) -> FloatArray:
        """Normalised values of one tap ("": of the offset) at the kept samples, after the filter of one pole."""
        key = (axes, name, lag, pole, order)
        if key not in self._columns:
            whole = self._normalised(name, lag) if name else np.ones(len(self._run_index))
            if pole > 0.0:
                whole = _first_order(whole, pole, self._since, order)
            self._columns[key] = whole[self._index(axes)]
        return self._columns[key]

    def _normalised(self, name: str, lag: int) -> FloatArray:
        bounds = self.bank.bounds(name)
        return np.concatenate([delayed(normalise(values, bounds), lag) for values in self.bank.values(name)])

    def _index(self, axes: tuple[str, ...]) -> np.ndarray:
        """Kept samples, for filters also the last before each jump of a partition variable."""
        if axes not in self._indices:
            kept = (np.arange(len(self._run_index)) - self._first[self._run_index]) % self.keep_every == 0
            if self.keep_every > 1:
                for name in axes:
                    kept[:-1] |= np.abs(np.diff(self._normalised(name, axis_lag(name)))) > _JUMP
            self._indices[axes] = np.flatnonzero(kept)
        return self._indices[axes]

    @cached_property
    def _run_index(self) -> np.ndarray:
        return np.repeat(np.arange(len(self.bank.runs)), [len(run) for run in self.bank.runs])

    @cached_property
    def _first(self) -> np.ndarray:
        """Index of each run's first sample."""
        return np.concatenate([[0], np.cumsum([len(run) for run in self.bank.runs])[:-1]])

    @cached_property
    def _starts(self) -> np.ndarray:
        parts = [run.segment_starts for run in self.bank.runs]
        return np.concatenate([first + np.array(part) for first, part in zip(self._first, parts, strict=True)])

    @cached_property
    def _since(self) -> np.ndarray:
        return samples_since_start(len(self._run_index), self._starts)

    @cached_property
    def _part(self) -> np.ndarray:
        return np.searchsorted(self._starts, np.arange(len(self._run_index)), side="right")

    @cached_property
    def _fold(self) -> np.ndarray:
        return group_numbers(self._run_index, balanced_groups(self.bank.runs), ~np.isnan(self._voltage)) % N_FOLDS

    @cached_property
    def _voltage(self) -> FloatArray:
        return normalise(np.concatenate([run.voltage_V for run in self.bank.runs]), self.bank.bounds(VOLTAGE))


def _poles(time_constants_s: tuple[float, ...], dt_s: float) -> list[float]:
    """Poles, the fastest first, none too close to the next."""
    known: list[float] = []
    for tau_s in sorted(time_constants_s):
        known.append(max(tau_s, _LEAST_RATIO * known[-1]) if known else tau_s)
    return [float(np.exp(-dt_s / tau_s)) for tau_s in known]


@njit(cache=True)
def _first_order(values: np.ndarray, pole: float, since: np.ndarray, order: int) -> np.ndarray:
    """x(k) = p x(k-1) + u(k), 0 at the initial values of each part."""
    out, state = np.empty(values.shape[0]), 0.0
    for k in range(values.shape[0]):
        state = 0.0 if since[k] < order else pole * state + values[k]
        out[k] = state
    return out


@njit(cache=True)
def _filtered_rows(
    first: int, validity: np.ndarray, steps: np.ndarray, decay: np.ndarray, carry: np.ndarray, out: np.ndarray
) -> None:
    """Rows of Phi_i u_j after the common filter; `carry` (n_filters, P) holds each filter's last state."""
    n_models, q = validity.shape[1], steps.shape[2]
    for row in range(out.shape[0]):
        k = first + row
        for filtered in range(steps.shape[0]):
            kept, step = decay[filtered, k], steps[filtered, k]
            for i in range(n_models):
                weight = validity[k, i]
                for j in range(q):
                    c = i * q + j
                    state = kept * carry[filtered, c] + weight * step[j]
                    carry[filtered, c] = state
                    out[row, c] = state if filtered == 0 else out[row, c] + state
