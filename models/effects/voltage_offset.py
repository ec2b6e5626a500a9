"""A voltage sensor that reads a constant too much."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Parameter
from models.effects.view import View


def _regressors(view: View) -> FloatArray:
    return np.ones((len(view.index), 1))


EFFECT = Effect(
    name="voltage_offset",
    title="Offset of the voltage sensor",
    recognise="the error is the same at every state of charge, current and temperature",
    source="sensor model, constant error",
    parameters=(Parameter("offset_V", "V", "what the sensor reads too much"),),
    regressors=_regressors,
    absorbed=True,
)
