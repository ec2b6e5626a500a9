"""Corrections of a run's inputs: effects that sit in a sensor or in an assumption, not in the network's structure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from models.errors import ModelError
from models.timeseries import TimeSeries

Values = dict[str, float]


def _current_offset(run: TimeSeries, values: Values) -> TimeSeries:
    return replace(run, current_A=run.current_A - values["offset_A"])


def _self_discharge(run: TimeSeries, values: Values) -> TimeSeries:
    """What charges the cell is what the sensor reads less what leaks."""
    return replace(run, current_A=run.current_A - values["leakage_A"])


def _voltage_offset(run: TimeSeries, values: Values) -> TimeSeries:
    return replace(run, voltage_V=run.voltage_V - values["offset_V"])


def _dead_time(run: TimeSeries, values: Values) -> TimeSeries:
    known = np.isfinite(run.voltage_V)
    earlier = np.interp(run.time_s + values["delay_s"], run.time_s[known], run.voltage_V[known])
    return replace(run, voltage_V=np.where(known, earlier, np.nan))


def _temperature_sensor(run: TimeSeries, values: Values) -> TimeSeries:
    if run.ambient_degC is None:
        raise ModelError(
            f"{run.name}: a temperature sensor's gain is corrected against ambient, which was not measured"
        )
    rise_K = (run.temperature_degC - values["offset_K"] - run.ambient_degC) / values["gain"]
    return replace(run, temperature_degC=run.ambient_degC + rise_K)


_CORRECTIONS: dict[str, Callable[[TimeSeries, Values], TimeSeries]] = {
    "current_offset": _current_offset,
    "self_discharge": _self_discharge,
    "voltage_offset": _voltage_offset,
    "dead_time": _dead_time,
    "temperature_sensor": _temperature_sensor,
}


def corrects_inputs(effect: str) -> bool:
    """Whether an effect is put right in a run's columns."""
    return effect in _CORRECTIONS


def corrected(run: TimeSeries, effect: str, values: Values) -> TimeSeries:
    """Return a run as it would have been measured without an effect in its sensors.

    Parameters
    ----------
    run : as measured
    effect : name
    values : of its parameters
    """
    return _CORRECTIONS[effect](run, values) if effect in _CORRECTIONS else run
