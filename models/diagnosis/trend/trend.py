"""One call: a series of runs or cycles of one cell against the cell as it was."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.diagnosis.diagnosis import check_training, known_of
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.known.record import known_in
from models.diagnosis.known.thresholds import KNOWN
from models.diagnosis.reference.record import Record, make_record
from models.diagnosis.trend.alarms import claimed, lasting
from models.diagnosis.trend.answer import answer
from models.diagnosis.trend.estimate import Weighed, estimate
from models.diagnosis.trend.forecast import forecast
from models.diagnosis.trend.life import Places, RunTrend, Trend
from models.diagnosis.trend.series import change_points, smoothed, ways_of
from models.diagnosis.trend.settings import SETTINGS
from models.diagnosis.trend.weighing import EVERY
from models.effects.input_correction import as_read
from models.network.local_model_network import LocalModelNetwork
from models.readouts.stages import stages_of

# Runs that stand for the cell as it was, where nothing is known of those that the model was made from.
_STAND_IN = 3

Progress = Callable[[float, str], None]


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

    Raises
    ------
    ModelError
        No run, or runs that the model cannot be held against.
    """
    started = time.perf_counter()
    if not runs:
        raise ModelError("no trend: no run was given")
    if train and (train_soc is None or len(train_soc) != len(train)):
        raise ModelError("each training run needs its SoC at the start")
    along = places or Places()
    at = np.arange(1.0, len(runs) + 1.0) if along.at is None else np.array(along.at)
    if len(at) != len(runs):
        raise ModelError(f"{len(at)} place(s) for {len(runs)} run(s): give one for each")
    known = memory if memory is not None else _known(network, runs, initial_soc, train or [], train_soc or [])
    stds = soc_std or [KNOWN.start_soc] * len(runs)
    held: list[tuple[Weighed, Record, float]] = []
    for number, (run, soc, std) in enumerate(zip(runs, initial_soc, stds, strict=True)):
        progress(number / len(runs), run.name)
        held.append(_held(network, known, (run, soc, std)))
    seen = [weighed.chances for weighed, _, _ in held]
    by_set = smoothed(seen)
    by_way = ways_of(seen, by_set)
    alone = np.array([each.nothing for each in seen])
    borne_out = claimed(alone, SETTINGS.nothing, SETTINGS.alarms)
    borne_out = lasting(borne_out, alone, by_set[:, EVERY.index(())], SETTINGS.nothing, SETTINGS.claim)
    entries = []
    for k, (run, (weighed, record, begun)) in enumerate(zip(runs, held, strict=True)):
        beside = [held[j][0] for j in np.flatnonzero(at == at[k]) if j != k]
        told = answer(weighed, record, by_set[k], bool(borne_out[k]), begun, by_way[k], beside)
        entries.append(RunTrend(run.name, float(at[k]), weighed.state, record.rms_mV, told))
    capacity_Ah = np.array([weighed.state.capacity_Ah for weighed, _, _ in held])
    ahead = forecast(at, capacity_Ah, known.cell.capacity_Ah, along.end, along.unit)
    stages = stages_of([(rec.runs[0], rec.error_V[0]) for _, rec, _ in held], at, known.cell.capacity_Ah)
    return Trend(tuple(entries), tuple(change_points(seen)), ahead, time.perf_counter() - started, stages)


def _known(
    network: LocalModelNetwork,
    runs: list[TimeSeries],
    soc: list[float],
    train: list[TimeSeries],
    train_soc: list[float],
) -> KnownRuns:
    """What is known of the cell as it was, made once for the whole series."""
    grid = [to_grid(as_read(network.record, run), network.structure.dt_s) for run in train]
    check_training(grid)
    if not grid:
        found = known_in(network)
        if found is not None:
            return found
    return known_of(network, make_record(network, runs[:_STAND_IN], soc[:_STAND_IN]), grid, train_soc)


def _held(
    network: LocalModelNetwork, known: KnownRuns, given: tuple[TimeSeries, float, float]
) -> tuple[Weighed, Record, float]:
    """One run: what it says of the cell, the network's error on it, and when it was begun."""
    run, soc, std = given
    started = time.perf_counter()
    try:
        with np.errstate(over="raise"):
            record = make_record(network, [run], [soc])
            return estimate(known, record.runs[0], soc, std), record, started
    except (ArithmeticError, IndexError, ValueError) as error:
        if isinstance(error, ModelError) and run.name in str(error):
            raise
        raise ModelError(f"{run.name}: this run cannot be weighed: {str(error).splitlines()[0][:200]}") from error
