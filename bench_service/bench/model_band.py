"""The band of a model along a run's profile; loaded with the first run that asks for one."""

import math
from dataclasses import replace

import numpy as np

from bench_service.bench.plausibility import ExpectedVoltage
from bench_service.bench.player import make_player
from bench_service.bench.request import BandOrder, RunRequest
from models.data.resampling import GridRun, to_grid
from models.data.timeseries import TimeSeries
from models.network.local_model_network import LocalModelNetwork
from models.uncertainty.bands import prediction_band
from models.uncertainty.model_uncertainty import uncertainty_of


def expected_voltage(request: RunRequest, order: BandOrder) -> ExpectedVoltage:
    """Simulate a profile with a model, from rest, with its 95 % band.

    Raises
    ------
    ValueError
        The model cannot be used, does not say what it does not know, or the state of charge is not known.
    """
    if request.initial_soc is None:
        raise ValueError("a model's band needs the state of charge at the start; state initial_soc")
    network = LocalModelNetwork.from_json(order["model"])
    uncertainty = uncertainty_of(network)
    if uncertainty is None:
        raise ValueError("the model does not say what it does not know, so it has no band; fit it again")
    rest = max(1, network.structure.output_order) + 1
    band = prediction_band(network, _planned(request, order, network.dt_s, rest), request.initial_soc, uncertainty)
    lower_V, upper_V = band.lower_V[rest:].tolist(), band.upper_V[rest:].tolist()
    return ExpectedVoltage(network.dt_s, lower_V, upper_V, order["margin_V"], order["for_s"])


def _planned(request: RunRequest, order: BandOrder, dt_s: float, rest: int) -> GridRun:
    """Return the run as it is planned, behind so many samples of rest: a model that feeds outputs back begins there."""
    player = make_player(request.time_s, request.current_A, request.dt_s)
    before_s = rest * dt_s
    before = np.linspace(0.0, before_s, math.ceil(before_s / request.dt_s) + 1)
    time_s = np.concatenate([before, before_s + request.dt_s * np.arange(1, player.n_ticks + 1)])
    # A logged current has flowed up to its time, a set-point flows from then on.
    current_A = np.concatenate([np.zeros(len(before)), player.setpoint_A])
    warmth, unknown = np.full(len(time_s), order["temperature_degC"]), np.full(len(time_s), np.nan)
    run = to_grid(TimeSeries(time_s, current_A, unknown, warmth, warmth, name="planned"), dt_s)
    if order["voltage_V"] is None:
        return run
    voltage_V = np.where(np.arange(len(run)) <= rest, order["voltage_V"], np.nan)
    return replace(run, voltage_V=voltage_V, measured=~np.isnan(voltage_V))
