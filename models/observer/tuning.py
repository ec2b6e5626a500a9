"""Finding the filter's noise from identification data: the likelihood of the innovations.

On identification data the state of charge is counted from a known start, so the model's free-run error is what the
filter will have to live with. A small Kalman filter with the same noise as the observer's (white noise, quick and slow
model error, drift of the state of charge) runs over that error, and its innovations are made as likely as possible.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import njit
from scipy.optimize import minimize
from scipy.signal import lfilter

from models.electrothermal_loop import CODES, FILTERED, RELAXATION, SQUARED
from models.errors import ModelError
from models.local_model_network import LocalModelNetwork
from models.observer.compiled import NET_S
from models.observer.fuzzy_observer import FuzzyObserver
from models.observer.settings import ObserverSettings, default_settings, error_levels
from models.prediction_band import NORMAL_95
from models.regression import Dataset
from models.resampling import GridRun, to_grid
from models.signals import parse_signal, soc_by_counting
from models.timeseries import FloatArray, TimeSeries

# What is tuned, each between bounds and with the spread of the weak prior around its start (in its logarithm).
_TUNED = (
    "voltage_std_V",
    "quick_error_std_V",
    "quick_error_time_s",
    "slow_error_std_V",
    "slow_error_time_s",
    "slow_error_soc",
    "soc_std_per_sqrt_s",
    "resistance_std",
)
_BOUNDS = {
    "voltage_std_V": (2e-5, 0.5),
    "quick_error_std_V": (2e-5, 0.5),
    "quick_error_time_s": (2.0, 1800.0),
    "slow_error_std_V": (5e-5, 0.5),
    "slow_error_time_s": (7200.0, 2e5),
    "slow_error_soc": (0.01, 1.0),
    "resistance_std": (1e-4, 0.3),
    # The reference is itself counted charge: more drift than a good counter has would only be model error in disguise.
    "soc_std_per_sqrt_s": (1e-7, 3e-6),
}
_START = {
    "quick_error_time_s": 20.0,
    "slow_error_time_s": 3e4,
    "slow_error_soc": 0.1,
    "soc_std_per_sqrt_s": 1e-6,
}
# Time constants are hardly seen in a short run: the prior keeps them within about this factor of the start.
_PRIOR_FACTOR = 4.0
# SoC is moved by this much to see how the output follows.
_STEP_SOC = 0.002
# So many samples are looked at, the same number from the beginning of each run.
_LONGEST = 100_000
_ITERATIONS = 500
# The band is calibrated from these wrong starts, and widened by no more than this.
_STARTS_OFF = (-0.3, 0.0, 0.3)
_BAND_FACTORS = (0.7, 8.0)
# Factors on slow error and noise, tried around what is most likely; the first is that itself.
_AROUND = ((1.0, 1.0), (0.3, 1.0), (3.0, 1.0), (0.3, 3.0), (1.0, 3.0), (3.0, 3.0))
_CLEARLY, _WORTH_SOC = 0.9, 0.001


@dataclass(frozen=True)
class TuningData:
    """Free-run errors of all runs, one after the other.

    Attributes
    ----------
    error_V : (N,) measured minus simulated, NaN where not measured
    slope_V : (N,) change of the output per unit of SoC
    level : (N,) size of the model's error there, relative to all
    moved : (N,) size of the SoC's net change in each sample, averaged as the observer does
    overpotential_V : (N,) what the current does to the output
    starts : first index of each run
    """

    error_V: FloatArray
    slope_V: FloatArray
    level: FloatArray
    moved: FloatArray
    overpotential_V: FloatArray
    starts: np.ndarray
    dt_s: float


def tune(
    network: LocalModelNetwork,
    runs: list[TimeSeries],
    initial_soc: list[float],
    settings: ObserverSettings | None = None,
    held_out: tuple[list[TimeSeries], list[float]] | None = None,
) -> ObserverSettings:
    """Find the noise that makes the innovations on identification data most likely.

    Parameters
    ----------
    network : the model
    runs, initial_soc : runs that it was identified from, and the fraction at which each starts
    settings : where to begin, and what is not tuned (sensor offset, capacity); by default the model's own
    held_out : runs that the fit did not see and their initial SoC, to calibrate the band; by default the same runs

    Returns
    -------
    ObserverSettings
        With the factor by which the band is widened so that it holds the counted state of charge as often as it says.

    Raises
    ------
    ModelError
        Nothing was measured.
    """
    grid = [to_grid(run, network.dt_s) for run in runs]
    judged = None if held_out is None else ([to_grid(run, network.dt_s) for run in held_out[0]], held_out[1])
    return tune_on_grid(network, grid, initial_soc, settings, judged)


def with_tuned_observer(
    network: LocalModelNetwork,
    runs: list[TimeSeries],
    initial_soc: list[float],
    held_out: tuple[list[TimeSeries], list[float]] | None = None,
) -> LocalModelNetwork:
    """Return the network with the settings that `tune` finds in its record, where every observer looks for them.

    A network that no observer can use is returned with a reservation that says why.
    """
    try:
        found: dict[str, Any] = {"observer": tune(network, runs, initial_soc, held_out=held_out).to_json()}
    except ModelError as error:
        found = {"reservations": [*network.record.get("reservations", []), f"observer not tuned: {error}"]}
    return replace(network, record=network.record | found)


def tune_on_grid(
    network: LocalModelNetwork,
    runs: list[GridRun],
    initial_soc: list[float],
    settings: ObserverSettings | None = None,
    held_out: tuple[list[GridRun], list[float]] | None = None,
) -> ObserverSettings:
    """Tune with runs that are on the model's grid already; see `tune`."""
    data = tuning_data(network, runs, initial_soc)
    rms_V = float(np.sqrt(np.nanmean(data.error_V**2)))
    first = replace(
        settings or default_settings(network),
        voltage_std_V=0.5 * rms_V,
        quick_error_std_V=0.5 * rms_V,
        slow_error_std_V=0.7 * rms_V,
        **_START,
    )
    start = np.log([getattr(first, name) for name in _TUNED])
    low, high = np.log(np.array([_BOUNDS[name] for name in _TUNED])).T
    weak = np.array([name in _START for name in _TUNED]) / np.log(_PRIOR_FACTOR)

    def cost(values: FloatArray) -> float:
        inside = np.clip(values, low, high)
        beyond = float(np.sum((values - inside) ** 2))
        prior = 0.5 * float(np.sum((weak * (inside - start)) ** 2))
        return -log_likelihood(data, np.exp(inside)) + prior + 1e3 * beyond

    simplex = np.vstack([start, start + 0.7 * np.eye(len(start))])
    found = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": _ITERATIONS, "xatol": 0.02, "fatol": 0.1, "adaptive": True},
    )
    values = dict(zip(_TUNED, np.exp(np.clip(found.x, low, high)).tolist(), strict=True))
    judged = (runs, initial_soc) if held_out is None else held_out
    likely = replace(first, **values, band_factor=1.0)
    around = [
        replace(likely, slow_error_std_V=slow * likely.slow_error_std_V, voltage_std_V=noise * likely.voltage_std_V)
        for slow, noise in _AROUND
    ]
    errors = [_errors(network, runs, initial_soc, settings)[0] for settings in around]
    # What is most likely stays unless something near it is clearly better at what it is for.
    best = int(np.argmin(errors))
    chosen = around[best] if errors[best] < min(_CLEARLY * errors[0], errors[0] - _WORTH_SOC) else likely
    return replace(chosen, band_factor=_errors(network, *judged, chosen)[1])


def _errors(
    network: LocalModelNetwork, runs: list[GridRun], initial_soc: list[float], settings: ObserverSettings
) -> tuple[float, float]:
    """RMS error of the SoC from wrong starts, and by how much the band must be wider to hold 95 % of it.

    The likelihood sees how the model's error changes from sample to sample; what stays with a place on the
    open-circuit curve, and what a bent curve does to a linear filter, it hardly sees.
    """
    observer = FuzzyObserver(network, settings)
    ratios, errors = [], []
    for run, soc in zip(runs, initial_soc, strict=True):
        counted = soc_by_counting(run.charge_Ah, soc, network.cell.capacity_Ah, network.cell.efficiency)
        for off in _STARTS_OFF:
            state = observer.initial(float(np.clip(soc + off, 0.0, 1.0)))
            _, rows = observer.replay(state, run.current_A, run.voltage_V, run.temperature_degC)
            late = slice(len(rows) // 4, None)
            errors.append(np.abs(rows[late, 0] - counted[late]))
            ratios.append(errors[-1] / np.maximum(rows[late, 1], 1e-9))
    factor = float(np.clip(np.percentile(np.concatenate(ratios), 95.0) / NORMAL_95, *_BAND_FACTORS))
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2))), factor


def tuning_data(network: LocalModelNetwork, runs: list[GridRun], initial_soc: list[float]) -> TuningData:
    """Free-run errors with what the filter needs to know of each sample."""
    if not runs or not any(run.measured.any() for run in runs):
        raise ModelError("the observer cannot be tuned: no run with a measured voltage was given")
    parts: list[list[FloatArray]] = [[], [], [], [], []]
    starts, total = [], 0
    levels = error_levels(network)
    for run, soc in zip(runs, initial_soc, strict=True):
        kept = slice(0, max(_LONGEST // len(runs), 1))
        simulated = network.free_run_V(run, soc)
        moved_up, moved_down = (network.free_run_V(run, soc + sign * _STEP_SOC) for sign in (1.0, -1.0))
        counted = soc_by_counting(run.charge_Ah, soc, network.cell.capacity_Ah, network.cell.efficiency)
        parts[0].append((run.voltage_V - simulated)[kept])
        parts[1].append(((moved_up - moved_down) / (2.0 * _STEP_SOC))[kept])
        data = network.dataset([run], [soc])
        validity = network.partition.validity(data.z)
        parts[2].append((validity @ levels)[kept])
        share = min(network.dt_s / NET_S, 1.0)
        net = lfilter([share], [1.0, share - 1.0], np.diff(counted, prepend=counted[:1]))
        parts[3].append(np.abs(net)[kept])
        parts[4].append(_overpotential_V(network, validity @ network.theta, data)[kept])
        starts.append(total)
        total += len(parts[0][-1])
    return TuningData(*(np.concatenate(part) for part in parts), starts=np.array(starts), dt_s=network.dt_s)


def _overpotential_V(network: LocalModelNetwork, blended: FloatArray, data: Dataset) -> FloatArray:
    """(N,) what the current does to the output once it has settled; the observer has the same."""
    order, out = network.structure.output_order, np.zeros(len(data))
    for tap, (signal, _) in enumerate(network.structure.taps()):
        if CODES[parse_signal(signal).kind] in (FILTERED, SQUARED, RELAXATION):
            low, high = network.scaling[signal]
            out += blended[:, order + tap] * (data.u[:, tap] + low / (high - low))
    return network.voltage_span_V * out / (1.0 - blended[:, :order].sum(axis=1))


def log_likelihood(data: TuningData, values: FloatArray) -> float:
    """Log-likelihood of the innovations for the tuned values, in the order of the settings that are tuned."""
    return float(
        _log_likelihood(
            data.error_V,
            data.slope_V,
            data.level,
            data.moved,
            data.overpotential_V,
            data.starts,
            data.dt_s,
            *values.tolist(),
        )
    )


@njit(cache=True)
def _log_likelihood(
    error_V: np.ndarray,
    slope_V: np.ndarray,
    level: np.ndarray,
    moved: np.ndarray,
    overpotential_V: np.ndarray,
    starts: np.ndarray,
    dt_s: float,
    voltage_std_V: float,
    quick_std_V: float,
    quick_s: float,
    slow_std_V: float,
    slow_s: float,
    slow_soc: float,
    soc_std: float,
    resistance_std: float,
) -> float:
    x, p, h, seen = np.zeros(4), np.zeros((4, 4)), np.zeros(4), np.zeros(4)
    keep = np.ones(4)
    keep[1] = np.exp(-dt_s / quick_s)
    total, part = 0.0, 0
    for k in range(error_V.shape[0]):
        if part < starts.shape[0] and k == starts[part]:
            x[:] = 0.0
            p[:, :] = 0.0
            p[1, 1] = p[2, 2] = p[3, 3] = 1.0
            part += 1
        else:
            keep[2] = keep[3] = np.exp(-dt_s / slow_s - moved[k] / slow_soc)
            for a in range(4):
                x[a] *= keep[a]
                for b in range(4):
                    p[a, b] *= keep[a] * keep[b]
            p[0, 0] += soc_std**2 * dt_s
            p[1, 1] += 1.0 - keep[1] ** 2
            p[2, 2] += 1.0 - keep[2] ** 2
            p[3, 3] += 1.0 - keep[3] ** 2
        if np.isnan(error_V[k]):
            continue
        h[0], h[1], h[2] = slope_V[k], quick_std_V * level[k], slow_std_V * level[k]
        h[3] = resistance_std * overpotential_V[k]
        variance, innovation = voltage_std_V**2, error_V[k]
        for a in range(4):
            seen[a] = p[a, 0] * h[0] + p[a, 1] * h[1] + p[a, 2] * h[2] + p[a, 3] * h[3]
            variance += h[a] * seen[a]
            innovation -= h[a] * x[a]
        total -= 0.5 * (innovation * innovation / variance + np.log(variance))
        for a in range(4):
            x[a] += seen[a] / variance * innovation
            for b in range(4):
                p[a, b] -= seen[a] * seen[b] / variance
    return total
