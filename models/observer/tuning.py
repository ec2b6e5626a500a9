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
from models.input_correction import as_read
from models.local_model_network import LocalModelNetwork
from models.observer.fuzzy_observer import FuzzyObserver
from models.observer.places import NET_S
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
# What is assumed of the current sensor where nothing is declared: a tuned model is good enough to tell so much.
# The band is calibrated from these wrong starts, each with an offset of that sensor in multiples of the assumed
# standard deviation. It is widened by no more than this, and never narrower than the filter's own: what hours of
# calibration have told of the start and the sensors, a shorter run does not know.
_OFFSET_STD_C = 0.01
_STARTS_OFF = ((-0.3, -1.0), (0.0, 0.0), (0.3, 1.0))
_BAND_FACTORS = (1.0, 8.0)
_HELD = 0.95
# This part of a run is left to the start. Neighbouring samples say the same; one in so many is enough to judge by.
_SETTLING = 20
_EVERY = 10
# Factors on slow error and noise, tried around what is most likely; the first is that itself.
_AROUND = tuple((slow, noise) for noise in (1.0, 3.0, 10.0) for slow in (1.0, 0.3, 3.0))
_CLEARLY = 0.9


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
    settings : where to begin, and what is not tuned (sensor offset, capacity); by default the model's own, with a
        standard deviation of the current sensor's offset of 1 % of 1C
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

    def read(run: TimeSeries) -> GridRun:
        return to_grid(as_read(network.record, run), network.dt_s)

    grid = [read(run) for run in runs]
    judged = None if held_out is None else ([read(run) for run in held_out[0]], held_out[1])
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
        settings or replace(default_settings(network), current_offset_std_C=_OFFSET_STD_C),
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
    likely = replace(first, **values)
    around = [
        replace(likely, slow_error_std_V=slow * likely.slow_error_std_V, voltage_std_V=noise * likely.voltage_std_V)
        for slow, noise in _AROUND
    ]
    bands = [calibrated_band(network, *judged, candidate) for candidate in around]
    best = int(np.argmin([band.score for band in bands]))
    # What is most likely stays unless something near it is clearly better at what it is for.
    if bands[best].score > _CLEARLY * bands[0].score:
        best = 0
    # Halfway: the likely noise alone calls what the model errs by an alarm, the noise chosen for the SoC hides it.
    judged_V = float(np.sqrt(likely.voltage_std_V * around[best].voltage_std_V))
    return replace(around[best], band_factor=bands[best].factor, judged_noise_V=judged_V)


@dataclass(frozen=True)
class Band:
    """How good estimates from wrong starts and with sensor offsets are.

    Attributes
    ----------
    soc_rmse : RMS error of the SoC
    factor : by how much the standard deviation must be widened so that 1.96 of it hold 95 % of the errors
    score : mean interval score of the band so widened (Gneiting and Raftery, J. Am. Stat. Assoc. 102, 2007, eq. 43):
        its width, and what lies beyond it times 2 / 0.05; small for an accurate estimate whose band follows its error
    """

    soc_rmse: float
    factor: float
    score: float


def calibrated_band(
    network: LocalModelNetwork, runs: list[GridRun], initial_soc: list[float], settings: ObserverSettings
) -> Band:
    """Judge settings by the SoC that they lead to, and say by how much the band must be wider.

    The likelihood sees how the model's error changes from sample to sample; what stays with a place on the
    open-circuit curve, and what a bent curve does to a linear filter, it hardly sees.
    """
    observer = FuzzyObserver(network, replace(settings, band_factor=1.0))
    errors, stds = [], []
    for run, soc in zip(runs, initial_soc, strict=True):
        counted = soc_by_counting(run.charge_Ah, soc, network.cell.capacity_Ah, network.cell.efficiency)
        late, seen = slice(len(run) // _SETTLING, None, _EVERY), []
        for off, offset in _STARTS_OFF:
            state = observer.initial(float(np.clip(soc + off, 0.0, 1.0)))
            current_A = run.current_A + offset * settings.current_offset_std_C * network.cell.capacity_Ah
            seen.append(observer.replay(state, current_A, run.voltage_V, run.temperature_degC)[1][late, :2])
        errors.append(np.concatenate([np.abs(rows[:, 0] - counted[late]) for rows in seen]))
        stds.append(np.concatenate([np.maximum(rows[:, 1], 1e-9) for rows in seen]))
    error, std = np.concatenate(errors), np.concatenate(stds)
    widest = _ratio_that_holds([error / std for error, std in zip(errors, stds, strict=True)])
    factor = float(np.clip(widest / NORMAL_95, *_BAND_FACTORS))
    half_width = factor * NORMAL_95 * std
    score = 2.0 * half_width + 2.0 / (1.0 - _HELD) * np.maximum(error - half_width, 0.0)
    return Band(float(np.sqrt(np.mean(error**2))), factor, float(np.mean(score)))


def _ratio_that_holds(ratios: list[FloatArray]) -> float:
    """Error in standard deviations that 95 % stay below, in a run that was not among those it was found from.

    Errors differ more from run to run than within one: the quantile is raised until each run, judged by the quantile
    of the others, is held often enough on average.
    """
    together = np.concatenate(ratios)
    for level in np.arange(_HELD, 0.9951, 0.005) if len(ratios) > 1 else ():
        held = [
            np.mean(own <= np.quantile(np.concatenate(ratios[:i] + ratios[i + 1 :]), level))
            for i, own in enumerate(ratios)
        ]
        if np.mean(held) >= _HELD:
            return float(np.quantile(together, level))
    return float(np.quantile(together, _HELD if len(ratios) == 1 else 0.995))


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
