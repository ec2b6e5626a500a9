"""One call: a series of runs or cycles of one cell against the cell as it was."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol, TypeVar

import numpy as np

from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.data.run_order import check_no_repeat, in_order
from models.data.timeseries import FloatArray, TimeSeries
from models.diagnosis.diagnosis import check_training, known_of
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.known.record import known_in
from models.diagnosis.known.thresholds import KNOWN
from models.diagnosis.reference.record import Record, make_record
from models.diagnosis.trend.alarms import claimed, lasting
from models.diagnosis.trend.answer import answer
from models.diagnosis.trend.estimate import Seen, Weighed, seen, weighed
from models.diagnosis.trend.forecast import forecast
from models.diagnosis.trend.life import Places, RunTrend, Trend
from models.diagnosis.trend.series import agreed, change_points, smoothed, together, ways_of
from models.diagnosis.trend.settings import SETTINGS
from models.diagnosis.trend.weights.sizes import EVERY
from models.diagnosis.trend.weights.weighing import Chances
from models.effects.input_correction import as_read
from models.network.local_model_network import LocalModelNetwork
from models.readouts.stages import stages_of

# Runs that stand for the cell as it was, where nothing is known of those that the model was made from.
_STAND_IN = 3

Progress = Callable[[float, str], None]
# The model and what is known of its training runs; a run with its state of charge at the start, and what that is held
# to be uncertain by; and what became of it: the network's error on it, and when it was begun.
_Cell = tuple[LocalModelNetwork, KnownRuns]
_Given = tuple[TimeSeries, float, float]
_Held = tuple[Weighed, Record, float]
S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")


class Spread(Protocol):
    """Does the same to many pieces, which share one thing, and gives what became of each in their order."""

    def __call__(self, function: Callable[[S, T], R], shared: S, pieces: Sequence[T]) -> Iterator[R]:
        """Begin with the first; `function` is a module's own, so that another process can find it."""
        ...


def in_turn(function: Callable[[S, T], R], shared: S, pieces: Sequence[T]) -> Iterator[R]:
    """One piece after the other."""
    return (function(shared, each) for each in pieces)


def trend(
    network: LocalModelNetwork,
    runs: list[TimeSeries],
    initial_soc: list[float],
    *,
    train: list[TimeSeries] | None = None,
    train_soc: list[float] | None = None,
    soc_std: list[float] | None = None,
    memory: KnownRuns | None = None,
    places: Places | None = None,
    progress: Progress = lambda share, text: None,
    spread: Spread = in_turn,
) -> Trend:
    """Follow a cell through a series of runs.

    Parameters
    ----------
    network : the model of the cell as it was
    runs, initial_soc : of the series, each with its SoC at the start, a fraction of what it holds then
    train, train_soc : the runs that the network was made from
    soc_std : standard deviation of each run's SoC at the start; None: that of a careful statement
    memory : of the training runs, where it is at hand already
    places : of the runs along the life of the cell, and its end; None: they are counted
    progress : called with the share done and what is being done
    spread : does the same to all cycles, several at a time where there is more than one processor

    Raises
    ------
    ModelError
        No run, a record that is given twice, or runs that the model cannot be held against.
    """
    started = time.perf_counter()
    _check_runs(runs)
    if train and (train_soc is None or len(train_soc) != len(train)):
        raise ModelError("each training run needs its SoC at the start")
    along = places or Places()
    at = _at(along, len(runs))
    known = memory if memory is not None else _known(network, runs, initial_soc, train or [], train_soc or [])
    stds = soc_std or [KNOWN.start_soc] * len(runs)
    groups = together(known.cell, at, np.array([_moved_Ah(run) for run in runs]))
    given = [[(runs[k], initial_soc[k], stds[k]) for k in group] for group in groups]
    held = _every(spread(_held, (network, known), given), given, progress)
    told = [agreed([held[k][0].chances for k in group]) for group in groups]
    by_group = smoothed(told)
    said = _said(told, by_group)
    group_of = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    by_set, by_way, borne_out = by_group[group_of], ways_of(told, by_group)[group_of], said[group_of]
    entries = []
    for k, (run, (own, record, begun)) in enumerate(zip(runs, held, strict=True)):
        beside = [held[j][0] for j in np.flatnonzero(at == at[k]) if j != k]
        found = answer(own, record, by_set[k], bool(borne_out[k]), begun, by_way[k], beside)
        entries.append(RunTrend(run.name, float(at[k]), own.state, record.rms_mV, found))
    capacity_Ah = np.array([own.state.capacity_Ah for own, _, _ in held])
    ahead = forecast(at, capacity_Ah, known.cell.capacity_Ah, along.end, along.unit)
    stages = stages_of([(rec.runs[0], rec.error_V[0]) for _, rec, _ in held], at, known.cell.capacity_Ah)
    # What the series does not let be said of any run since then is no change point either.
    points = [each.in_runs(groups) for each in change_points(told) if said[each.first :].any()]
    seconds = time.perf_counter() - started
    return Trend(tuple(entries), tuple(points), ahead, seconds, stages, known.cell.capacity_Ah, along.unit)


def _at(along: Places, n: int) -> FloatArray:
    """(n,) places of the runs."""
    at = np.arange(1.0, n + 1.0) if along.at is None else np.array(along.at)
    if len(at) != n:
        raise ModelError(f"{len(at)} place(s) for {n} run(s): give one for each")
    return at


def _check_runs(runs: list[TimeSeries]) -> None:
    if not runs:
        raise ModelError("no trend: no run was given")
    check_no_repeat(runs, "a series")


def _known(
    network: LocalModelNetwork,
    runs: list[TimeSeries],
    soc: list[float],
    train: list[TimeSeries],
    train_soc: list[float],
) -> KnownRuns:
    """What is known of the cell as it was, made once for the whole series."""
    train, train_soc = in_order(train, train_soc)
    grid = [to_grid(as_read(network.record, run), network.structure.dt_s) for run in train]
    check_training(grid)
    if not grid:
        found = known_in(network)
        if found is not None:
            return found
    return known_of(network, make_record(network, runs[:_STAND_IN], soc[:_STAND_IN]), grid, train_soc)


def _said(told: list[Chances], by_group: FloatArray) -> np.ndarray:
    """(n,) whether the series lets anything be said of each of its runs, or of those that are weighed together."""
    alone = np.array([each.nothing for each in told])
    said = claimed(alone, SETTINGS.nothing, SETTINGS.alarms)
    return lasting(said, alone, by_group[:, EVERY.index(())], SETTINGS.nothing, SETTINGS.claim)


def _moved_Ah(run: TimeSeries) -> float:
    """Charge that a run has moved, positive where it charges."""
    return float(np.sum(np.nan_to_num(run.current_A[1:]) * np.diff(run.time_s))) / 3600.0


def _every(found: Iterator[list[_Held]], given: list[list[_Given]], progress: Progress) -> list[_Held]:
    """All runs as they come, with word of how many are done."""
    held: list[_Held] = []
    whole = sum(len(group) for group in given)
    progress(0.0, given[0][0][0].name)
    for group, those in zip(given, found, strict=True):
        held += those
        progress(len(held) / whole, group[-1][0].name)
    return held


def _held(cell: _Cell, given: list[_Given]) -> list[_Held]:
    """Runs of one cycle, held against the cell as it was."""
    looked = [_seen(cell, each) for each in given]
    out = []
    for k, (run, record, started) in enumerate(looked):
        other = looked[1 - k][0] if len(looked) > 1 else None
        with _named(given[k][0]):
            out.append((weighed(run, other), record, started))
    return out


def _seen(cell: _Cell, given: _Given) -> tuple[Seen, Record, float]:
    (network, known), (run, soc, std) = cell, given
    started = time.perf_counter()
    with _named(run):
        record = make_record(network, [run], [soc])
        return seen(known, record.runs[0], soc, std), record, started


@contextmanager
def _named(run: TimeSeries) -> Iterator[None]:
    """Say of which run it is that something cannot be worked out."""
    try:
        with np.errstate(over="raise"):
            yield
    except (ArithmeticError, IndexError, ValueError) as error:
        if isinstance(error, ModelError) and run.name in str(error):
            raise
        raise ModelError(f"{run.name}: this run cannot be weighed: {str(error).splitlines()[0][:200]}") from error
