"""Stored runs as the arrays that models work on; used inside worker processes."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench_service.errors import BadRequestError, DamagedError
from bench_service.store.integrity import Expected, read_whole
from bench_service.store.samples import SampleReader
from bench_service.streams import CELLS
from models.data.metrics import noise_floor_V
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.module.log import ModuleLog

_FEWEST_SAMPLES = 2


@dataclass(frozen=True, slots=True)
class RunInput:
    """A stored run, the state of charge, 0..1, at its start, and what must be there of its samples."""

    run_id: str
    initial_soc: float
    n_samples: int | None = None
    sha256: str | None = None


def read_series(data_dir: Path, runs: Sequence[RunInput]) -> list[TimeSeries]:
    """Read the samples of runs; the name of each series is the run's id.

    Raises
    ------
    BadRequestError
        A run has too few samples to be used.
    DamagedError
        Samples of a run are missing or not those that were recorded.
    """
    with closing(SampleReader(data_dir)) as reader:
        return [_series(reader, run) for run in runs]


def read_logs(data_dir: Path, runs: Sequence[RunInput]) -> list[ModuleLog]:
    """Read the samples of a module's runs, with the voltages of its cells where those are stored; see `read_series`."""
    with closing(SampleReader(data_dir)) as reader:
        return [_log(reader, run) for run in runs]


def _log(reader: SampleReader, run: RunInput) -> ModuleLog:
    series, cells = _series(reader, run), reader.read(run.run_id, CELLS)
    if not cells.n:
        return ModuleLog(series)
    if cells.gaps or cells.n != len(series):
        raise DamagedError(f"run {run.run_id}: {cells.n} voltages of its cells for {len(series)} samples", run.run_id)
    names = [name for name in cells.columns if name != "time_s"]
    return ModuleLog(series, np.column_stack([cells.columns[name] for name in names]))


def _series(reader: SampleReader, run: RunInput) -> TimeSeries:
    run_id = run.run_id
    data = read_whole(reader, Expected(run_id, run.n_samples, run.sha256))
    if data.n < _FEWEST_SAMPLES:
        raise BadRequestError("the run has too few samples to be used", ("run", run_id), value=data.n)
    columns = data.columns
    ambient_degC = columns["ambient_degC"]
    return TimeSeries(
        time_s=columns["time_s"],
        current_A=columns["current_A"],
        voltage_V=columns["voltage_V"],
        temperature_degC=columns["temperature_degC"],
        ambient_degC=None if np.isnan(ambient_degC).all() else ambient_degC,
        name=run_id,
    )


def noise_floor_mV(series: Sequence[TimeSeries], dt_s: float) -> float | None:
    """Median of the runs' noise floors; None where no run tells."""
    grid = [to_grid(each, dt_s) for each in series]
    floors = [noise_floor_V(each.voltage_V, each.current_A) for each in grid]
    known = [floor for floor in floors if np.isfinite(floor)]
    return 1e3 * float(np.median(known)) if known else None
