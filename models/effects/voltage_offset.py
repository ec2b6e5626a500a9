"""A voltage sensor that reads a constant too much."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Parameter
from models.effects.expected import Expected, Form, one_form
from models.effects.reading import InputCorrection, Reading, Values
from models.effects.view import View

_USUAL_V = 0.01


def _regressors(view: View) -> FloatArray:
    return np.ones((len(view.index), 1))


def _without(read: Reading, values: Values) -> Reading:
    return read._replace(voltage_V=read.voltage_V - values["offset_V"])


def _expected(view: View) -> tuple[Form, ...]:
    return one_form(_USUAL_V * _regressors(view), "offset_V", "V", _USUAL_V)


EFFECT = Effect(
    name="voltage_offset",
    title="Offset of the voltage sensor",
    recognise="the error is the same at every state of charge, current and temperature",
    source="sensor model, constant error",
    parameters=(Parameter("offset_V", "V", "what the sensor reads too much"),),
    regressors=_regressors,
    absorbed=True,
    correction=InputCorrection(_without),
    expected=Expected(_expected),
)
