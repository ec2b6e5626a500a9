"""From runs to the arrays of a regression: normalised regressors, partition variables and outputs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from models.data.errors import NotIdentifiableError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network import signals
from models.network.folds import balanced_groups, group_numbers
from models.network.structure import Structure

Scaling = dict[str, tuple[float, float]]
VOLTAGE = "voltage"


@dataclass(frozen=True)
class CellContext:
    """What turns measured current into signals: capacity, efficiency and the current that counts as rest."""

    capacity_Ah: float
    efficiency: float = 1.0

    @property
    def rest_A(self) -> float:
        """Current magnitude in A up to which the cell counts as resting."""
        return signals.REST_C_RATE * self.capacity_Ah


@dataclass(frozen=True)
class Dataset:
    """Arrays of one or several runs, one after the other.

    Attributes
    ----------
    u : (N, q + 1) normalised input taps and a last column of ones
    z : (N, n_axes) normalised partition variables
    y : (N,) normalised voltage, NaN where missing
    starts : first index of each part; outputs never reach across
    run_index : (N,) which run a sample belongs to
    run_group : (runs,) in which group each run is held out; None: each in that of its own number
    keep_every : samples of the model's grid from one of these to the next
    """

    u: FloatArray
    z: FloatArray
    y: FloatArray
    starts: np.ndarray
    run_index: np.ndarray
    run_group: np.ndarray | None = None
    keep_every: int = 1

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.y)

    def groups(self) -> np.ndarray:
        """(N,) number of the group that each sample is held out with."""
        return group_numbers(self.run_index, self.run_group, ~np.isnan(self.y))


@dataclass(frozen=True)
class SignalBank:
    """Signals of several runs, each made once however many structures ask for it.

    Attributes
    ----------
    runs : on one grid
    initial_soc : fraction at the start of each run
    cell : capacity and efficiency
    """

    runs: list[GridRun]
    initial_soc: list[float]
    cell: CellContext
    _known: dict[str, list[FloatArray]] = field(default_factory=dict)
    _bounds: dict[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def range_degC(self) -> tuple[float, float]:
        """Lowest and highest temperature of all runs; 0 where none is known."""
        every = np.concatenate([run.temperature_degC for run in self.runs])
        return (0.0, 0.0) if np.isnan(every).all() else (float(np.nanmin(every)), float(np.nanmax(every)))

    @property
    def span_K(self) -> float:
        """Range of the temperature over all runs; 0 where none is known."""
        low_degC, high_degC = self.range_degC
        return high_degC - low_degC

    def values(self, name: str) -> list[FloatArray]:
        """(n,) values of a named signal over each run, in its physical unit."""
        if name not in self._known:
            self._known[name] = [
                run_source(run, soc, self.cell).values(name)
                for run, soc in zip(self.runs, self.initial_soc, strict=True)
            ]
        return self._known[name]

    def bounds(self, name: str) -> tuple[float, float]:
        """Range of a signal, or of the measured voltage, that is mapped to 0..1."""
        if name not in self._bounds:
            measured = name == VOLTAGE
            parts = [run.voltage_V[run.measured] for run in self.runs] if measured else self.values(name)
            self._bounds[name] = _bounds(name, parts)
        return self._bounds[name]

    def forget(self, names: Iterable[str]) -> None:
        """Drop signals that are not asked for again; they are made anew if they are."""
        for name in names:
            self._known.pop(name, None)


def run_source(run: GridRun, initial_soc: float, cell: CellContext) -> signals.RunSignals:
    """What the signals of one run are made from."""
    soc = signals.soc_by_counting(run.charge_Ah, initial_soc, cell.capacity_Ah, cell.efficiency)
    return signals.RunSignals(run.current_A, run.temperature_degC, soc, run.dt_s, cell.capacity_Ah)


def find_scaling(
    structure: Structure,
    runs: list[GridRun],
    initial_soc: list[float],
    cell: CellContext,
    bank: SignalBank | None = None,
) -> Scaling:
    """Ranges that map every signal of the training runs to 0..1; a constant signal gets a range of 1 unit around it."""
    known = bank or SignalBank(runs, initial_soc, cell)
    return {name: known.bounds(name) for name in (*structure.signals, VOLTAGE)}


def _bounds(name: str, parts: list[FloatArray]) -> tuple[float, float]:
    """Range of 0..1; a constant signal gets a range of 1 unit around it."""
    if name == "hysteresis":
        return -1.0, 1.0
    known = [p for p in parts if len(p)]
    if not known:
        raise NotIdentifiableError(f"no run has a value of {name}: the log lacks that column, or it is empty")
    low, high = min(float(p.min()) for p in known), max(float(p.max()) for p in known)
    return (low, high) if high - low > 1e-9 * max(1.0, abs(low)) else (low - 0.5, low + 0.5)


def normalise(values: FloatArray, bounds: tuple[float, float]) -> FloatArray:
    """Map a range to 0..1."""
    return (values - bounds[0]) / (bounds[1] - bounds[0])


def build_dataset(
    structure: Structure,
    scaling: Scaling,
    runs: list[GridRun],
    initial_soc: list[float],
    cell: CellContext,
    bank: SignalBank | None = None,
    keep_every: int = 1,
) -> Dataset:
    """Regressors, partition variables and outputs of several runs.

    The SoC in the partition space is SoC(k-1), as in the observer, where SoC(k) is not known yet when the validity
    functions are needed; all other partition variables are taken at k.

    Parameters
    ----------
    structure, scaling, runs, initial_soc, cell : what to build from
    bank : signals of these runs that are known already
    keep_every : keep only every n-th sample of each run; for structures without past outputs
    """
    known = bank or SignalBank(runs, initial_soc, cell)
    parts_u, parts_z, parts_y, starts, index = [], [], [], [], []
    offset = 0
    for number, run in enumerate(runs):
        kept = slice(None, None, keep_every)
        scaled = {name: normalise(known.values(name)[number], scaling[name]) for name in structure.signals}
        columns = [delayed(scaled[signal], lag)[kept] for signal, lag in structure.taps()]
        count = len(columns[0])
        parts_u.append(np.column_stack([*columns, np.ones(count)]))
        parts_z.append(np.column_stack([delayed(scaled[a.signal], axis_lag(a.signal))[kept] for a in structure.axes]))
        parts_y.append(normalise(run.voltage_V[kept], scaling[VOLTAGE]))
        # A part of which no sample is kept has no start: it would be that of what follows, or lie beyond the end.
        places = {-(-s // keep_every) for s in run.segment_starts}
        starts.extend(offset + place for place in sorted(places) if place < count)
        index.append(np.full(count, number))
        offset += count
    return Dataset(
        u=np.ascontiguousarray(np.vstack(parts_u)),
        z=np.ascontiguousarray(np.vstack(parts_z)),
        y=np.concatenate(parts_y),
        starts=np.array(starts, dtype=np.int64),
        run_index=np.concatenate(index),
        run_group=balanced_groups(runs),
        keep_every=keep_every,
    )


def delayed(values: FloatArray, lag: int) -> FloatArray:
    """Return values(k - lag), with the first value before the start."""
    if lag == 0:
        return values
    return np.concatenate([np.full(min(lag, len(values)), values[0]), values[:-lag]])


def axis_lag(signal: str) -> int:
    """Delay of a partition variable: a state of charge is that of the sample before, all others the present one."""
    return 1 if signals.is_soc(signal) else 0
