"""Finding the filter's noise from identification data: the likelihood of the innovations.

On identification data the state of charge is counted from a known start, so the model's free-run error is what the
filter will have to live with, once what the fit has hidden of it is put back (`unseen`). A small Kalman filter with the
same noise as the observer's (white noise, quick and slow model error, drift of the state of charge) runs over that
error, and its innovations are made as likely as possible. Around that the settings are looked for that serve the state
of charge best (`serving`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.errors import ModelError
from models.data.resampling import GridRun, to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.effects.input_correction import as_read
from models.network.local_model_network import LocalModelNetwork
from models.observer.filter.settings import ObserverSettings, default_settings
from models.observer.tuning.calibration import calibrated_band
from models.observer.tuning.innovations import TuningData, log_likelihood, tuning_data
from models.observer.tuning.serving import judged_noise_V, serving_best
from models.observer.tuning.unseen import as_they_are, as_unseen

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
_ITERATIONS = 500
# What is assumed of the current sensor where nothing is declared: a tuned model is good enough to tell so much.
_OFFSET_STD_C = 0.01


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
        settings = tune(network, runs, initial_soc, held_out=held_out)
    except ModelError as error:
        why = (*network.record.reservations, f"observer not tuned: {error}")
        return replace(network, record=replace(network.record, reservations=why))
    return replace(network, record=replace(network.record, observer=settings.to_json()))


def tune_on_grid(
    network: LocalModelNetwork,
    runs: list[GridRun],
    initial_soc: list[float],
    settings: ObserverSettings | None = None,
    held_out: tuple[list[GridRun], list[float]] | None = None,
) -> ObserverSettings:
    """Tune with runs that are on the model's grid already; see `tune`."""
    unseen = as_unseen(network, runs, initial_soc)
    data = tuning_data(unseen)
    rms_V = float(np.sqrt(np.nanmean(data.error_V**2)))
    first = replace(
        settings or replace(default_settings(network), current_offset_std_C=_OFFSET_STD_C),
        voltage_std_V=0.5 * rms_V,
        quick_error_std_V=0.5 * rms_V,
        slow_error_std_V=0.7 * rms_V,
        **_START,
    )
    likely = most_likely(data, first)
    judged = unseen if held_out is None else as_they_are(network, *held_out)
    best = serving_best(judged, likely, rms_V)
    factor = calibrated_band(judged, best).factor
    return replace(best, band_factor=factor, judged_noise_V=judged_noise_V(likely, best))


def most_likely(data: TuningData, first: ObserverSettings) -> ObserverSettings:
    """The noise that makes the innovations over free-run errors most likely, with a weak prior around the first."""
    start = np.log([getattr(first, name) for name in _TUNED])
    low, high = np.log(np.array([_BOUNDS[name] for name in _TUNED])).T
    weak = np.array([name in _START for name in _TUNED]) / np.log(_PRIOR_FACTOR)

    def cost(values: FloatArray) -> float:
        inside = np.clip(values, low, high)
        beyond = float(np.sum((values - inside) ** 2))
        prior = 0.5 * float(np.sum((weak * (inside - start)) ** 2))
        return -log_likelihood(data, np.exp(inside)) + prior + 1e3 * beyond

    simplex = np.vstack([start, start + 0.7 * np.eye(len(start))])
    # Lazy: 0.5 s of processor time.
    from scipy.optimize import minimize

    found = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": _ITERATIONS, "xatol": 0.02, "fatol": 0.1, "adaptive": True},
    )
    values = dict(zip(_TUNED, np.exp(np.clip(found.x, low, high)).tolist(), strict=True))
    return replace(first, **values)
