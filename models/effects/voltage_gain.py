"""A voltage sensor that reads a constant share too much."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Parameter
from models.effects.expected import Expected, Form, one_form
from models.effects.reading import InputCorrection, Reading, Values
from models.effects.view import View

# As much as a usual offset of 10 mV is of a cell's voltage.
_USUAL = 0.003


def _regressors(view: View) -> FloatArray:
    return view.voltage_V[:, None]


def _without(read: Reading, values: Values) -> Reading:
    return read._replace(voltage_V=read.voltage_V / (1.0 + values["gain"]))


def _expected(view: View) -> tuple[Form, ...]:
    return one_form(_USUAL * _regressors(view), "gain", "1", _USUAL)


EFFECT = Effect(
    name="voltage_gain",
    title="Gain of the voltage sensor",
    recognise="the error is the same share of the voltage at every state of charge and current: largest when full, "
    "least when empty",
    source="sensor model, constant gain",
    parameters=(Parameter("gain", "1", "share that the sensor reads too much"),),
    regressors=_regressors,
    absorbed=True,
    correction=InputCorrection(_without, possible=lambda values: values["gain"] > -1.0),
    # Between empty and full it differs from an offset by a seventh of its size: the simpler one is asked first.
    expected=Expected(_expected, share=0.3, learned=False),
)
