"""A temperature reading that is wrong by an offset or a gain against ambient."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Parameter, Warmth
from models.effects.expected import Expected
from models.effects.reading import InputCorrection, Reading, Values
from models.effects.thermal_view import ThermalView

# A reading that follows less of the rise tells hardly anything of the cell, and cannot be put right.
_LEAST_GAIN = 0.1


def _temperature(view: ThermalView, values: tuple[float, ...]) -> FloatArray:
    offset_K, gain = values
    rise_K = view.simulated(initial_rise_K=(view.initial_rise_K - offset_K) / gain) - view.ambient_degC
    return view.ambient_degC + gain * rise_K + offset_K


def _without(read: Reading, values: Values) -> Reading:
    rise_K = (read.temperature_degC - values["offset_K"] - read.ambient_degC) / values["gain"]
    return read._replace(temperature_degC=read.ambient_degC + rise_K)


EFFECT = Effect(
    name="temperature_sensor",
    title="Wrong temperature reading",
    recognise="the reading rises above the chamber by too much or too little, just as fast as before, while the "
    "voltage stays as it was",
    source="sensor model, constant error and gain against ambient",
    parameters=(
        Parameter("offset_K", "K", "what the sensor reads too much"),
        Parameter("gain", "1", "reading over true rise above ambient"),
    ),
    shows_over=("temperature_degC",),
    warmth=Warmth(
        _temperature, (0.0, 1.0), (0.1, 0.02), lambda _view, values: values, least=(float("-inf"), _LEAST_GAIN)
    ),
    absorbed=True,
    correction=InputCorrection(_without, needs_ambient=True, possible=lambda values: values["gain"] >= _LEAST_GAIN),
    expected=Expected(warmth=(3.0, 0.5)),
    like=("self_discharge",),
)
