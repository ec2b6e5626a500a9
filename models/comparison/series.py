"""A comparison sample by sample, as columns that any program can plot."""

from __future__ import annotations

import numpy as np

from models.comparison.placed_runs import place_runs
from models.comparison.reach import bands
from models.comparison.simulated_runs import RunComparison
from models.data.timeseries import FloatArray, TimeSeries
from models.network.cell_model import CellModel
from models.uncertainty.bands import NORMAL_95, PredictionBand


def series_columns(network: CellModel, runs: list[TimeSeries], initial_soc: list[float]) -> dict[str, np.ndarray]:
    """Both voltages of each run on the model's grid, one run after the other.

    Parameters
    ----------
    network, runs, initial_soc : as `models.comparison.figures.compare` takes them

    Returns
    -------
    dict of (n,)
        ``run``, ``time_s`` (as the run counts it), ``current_A``, ``temperature_degC``, ``soc``, ``voltage_V`` (NaN
        where none was measured), ``simulated_V``, ``band_V`` (half the width of the 95 % band; NaN where the model does
        not say what it does not know) and ``inside`` (1 in the trained domain, 0 outside).
    """
    compared = place_runs(network, runs, initial_soc)
    found = bands(network, [each.run for each in compared], [each.start for each in compared])
    parts = [
        _columns(series, each, None if found is None else found[number])
        for number, (series, each) in enumerate(zip(runs, compared, strict=True))
    ]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _columns(series: TimeSeries, compared: RunComparison, band: PredictionBand | None) -> dict[str, np.ndarray]:
    run = compared.run
    half_V: FloatArray = np.full(len(run), np.nan) if band is None else NORMAL_95 * band.std_V
    return {
        "run": np.full(len(run), run.name),
        "time_s": series.time_s[0] + run.time_s,
        "current_A": run.current_A,
        "temperature_degC": run.temperature_degC,
        "soc": compared.soc,
        "voltage_V": run.voltage_V,
        "simulated_V": compared.simulated_V,
        "band_V": half_V,
        "inside": compared.inside.astype(np.int64),
    }
