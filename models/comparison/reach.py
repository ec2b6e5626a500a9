"""How far a comparison reaches: samples outside the trained domain, gaps, and whether the prediction bands hold."""

from __future__ import annotations

from typing import TypedDict

import numpy as np

from models.comparison.start import Start, put_in_front
from models.data.history import PlacedRun
from models.data.resampling import GridRun
from models.data.stretches import stretches
from models.data.timeseries import FloatArray
from models.module.network import ModuleNetwork
from models.network.cell_model import CellModel
from models.network.local_model_network import LocalModelNetwork
from models.network.signals.filters import slow_current_A
from models.uncertainty.bands import PredictionBand, prediction_band
from models.uncertainty.model_uncertainty import Uncertainty, uncertainty_of
from models.uncertainty.soc_slip import slip_std_V


def inside_by(network: CellModel, run: GridRun, soc: FloatArray, start: Start | None = None) -> dict[str, np.ndarray]:
    """Whether each sample lies in the trained range, for each dimension of the domain; a missing value does.

    Parameters
    ----------
    network : its record holds the ranges
    run, soc : what is looked at
    start : where it begins, for the slow states; None: at rest
    """
    values = {"soc": soc, "current_A": run.current_A, "temperature_degC": run.temperature_degC}
    if "slow_current_A" in network.record.domain:
        found = PlacedRun(run, 0.0, 0) if start is None else put_in_front(network, run, start)
        values["slow_current_A"] = slow_current_A(found.run.current_A, run.dt_s)[found.n_before :]
    inside = {}
    for name, (low, high) in network.record.domain.items():
        # Half a percent of the range: sensor noise at the edge is not a new operating point.
        slack, value = 0.005 * (high - low), values[name]
        inside[name] = np.isnan(value) | ((value >= low - slack) & (value <= high + slack))
    return inside


class Gaps(TypedDict):
    """Where a run has no voltage, and how long it has no temperature."""

    run: str
    missing_share: float
    gaps: int
    longest_gap_s: float
    parts: int
    without_temperature_s: float


class BandFigures(TypedDict):
    """Whether prediction bands hold; see `band_figures`."""

    coverage_95: float | None
    coverage_95_inside: float | None
    mean_half_width_mV: float | None


def gaps(run: GridRun) -> Gaps:
    """Where a run has no voltage on the model's grid, and in how many parts a pause in the log cuts it.

    `without_temperature_s` is the longest time over which its temperature was not logged.
    """
    missing = ~run.measured
    lengths = [(last - first) * run.dt_s for first, last in stretches(missing)]
    return {
        "run": run.name,
        "missing_share": float(missing.mean()),
        "gaps": len(lengths),
        "longest_gap_s": max(lengths, default=0.0),
        "parts": len(run.segment_starts),
        "without_temperature_s": run.without_temperature_s,
    }


def bands(network: CellModel, runs: list[GridRun], starts: list[Start]) -> list[PredictionBand] | None:
    """95 % band of each run's free run; None where the model does not say what it does not know.

    Of a module it is that of the mean cell, as many times as there are cells in series: what the cells differ by, and
    what the module model is wrong by, is not in it.
    """
    if isinstance(network, ModuleNetwork):
        return _module_bands(network, runs, starts)
    if not isinstance(network, LocalModelNetwork):
        return None
    uncertainty = uncertainty_of(network)
    if uncertainty is None:
        return None
    return [_band(network, run, start, uncertainty) for run, start in zip(runs, starts, strict=True)]


def _module_bands(model: ModuleNetwork, runs: list[GridRun], starts: list[Start]) -> list[PredictionBand] | None:
    found = bands(model.network, [model.mean_cell_run(run) for run in runs], starts)
    in_series = model.module.cells_in_series
    return found and [
        PredictionBand(
            model.module.voltage_V(band.voltage_V, run.current_A),
            in_series * band.parameter_std_V,
            in_series * band.std_V,
            in_series * band.usual_V,
        )
        for band, run in zip(found, runs, strict=True)
    ]


def _band(network: LocalModelNetwork, run: GridRun, start: Start, uncertainty: Uncertainty) -> PredictionBand:
    found = put_in_front(network, run, start)
    band, kept = prediction_band(network, found.run, found.initial_soc, uncertainty), slice(found.n_before, None)
    # Nobody fitted the state of charge of these runs: what is stated may be off.
    slip_V = slip_std_V(network, found.run, found.initial_soc, band.std_V)
    std_V = np.hypot(band.std_V, slip_V)
    return PredictionBand(band.voltage_V[kept], band.parameter_std_V[kept], std_V[kept], band.usual_V[kept])


def band_figures(
    found: list[PredictionBand] | None, runs: list[GridRun], inside: list[np.ndarray]
) -> BandFigures | None:
    """Share of the measured voltages within the 95 % band, over all samples and inside the trained domain.

    Returns
    -------
    dict or None
        `coverage_95`, `coverage_95_inside` (None where nothing lies there), `mean_half_width_mV`; None without bands.
    """
    if found is None:
        return None
    within, known, held = [], [], np.concatenate(inside)
    for band, run in zip(found, runs, strict=True):
        within.append((run.voltage_V >= band.lower_V) & (run.voltage_V <= band.upper_V))
        known.append(run.measured)
    hit, counted = np.concatenate(within), np.concatenate(known)
    width = np.concatenate([band.upper_V - band.voltage_V for band in found])
    return {
        "coverage_95": _share(hit, counted),
        "coverage_95_inside": _share(hit, counted & held),
        "mean_half_width_mV": 1e3 * float(width[counted].mean()) if counted.any() else None,
    }


def expected_rmse_mV(found: list[PredictionBand] | None, runs: list[GridRun]) -> float | None:
    """Error to be expected of these runs: RMS of what the model may usually be wrong by where they go.

    It knows their currents, temperatures and states of charge, not their voltages; None without bands or voltage.
    """
    if found is None:
        return None
    known = np.concatenate([run.measured for run in runs])
    usual_V = np.concatenate([band.usual_V for band in found])[known]
    return 1e3 * float(np.sqrt(np.mean(usual_V**2))) if len(usual_V) else None


def _share(hit: np.ndarray, counted: np.ndarray) -> float | None:
    return float(hit[counted].mean()) if counted.any() else None
