"""A current sensor that reads a constant too much."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Parameter, Shift
from models.effects.expected import Expected
from models.effects.reading import InputCorrection, Reading, Values
from models.effects.view import View

_STEP_C_RATE = 2e-4
_LIMIT_C_RATE = 0.05


def _soc(view: View, offset_A: float) -> FloatArray:
    return view.soc - offset_A * view.run.time_s / (3600.0 * view.capacity_Ah)


def _voltage(view: View, offset_A: float) -> FloatArray:
    """Simulated with the true current, which is what the sensor reads less its offset."""
    return view.moved(soc=_soc(view, offset_A), current_A=view.run.current_A - offset_A)


def _step(view: View) -> float:
    return _STEP_C_RATE * view.capacity_Ah


def _regressors(view: View) -> FloatArray:
    return _voltage(view, _step(view))[:, None] / _step(view)


def _without(read: Reading, values: Values) -> Reading:
    return read._replace(current_A=read.current_A - values["offset_A"])


EFFECT = Effect(
    name="current_offset",
    title="Offset of the current sensor",
    recognise="the error grows with time, at rest too: counted charge drifts away from the cell's",
    source="sensor model, constant error",
    parameters=(Parameter("offset_A", "A", "what the sensor reads too much"),),
    shows_over=("time_h",),
    slow=True,
    regressors=_regressors,
    shift=Shift(
        _voltage,
        _step,
        lambda view: (-_LIMIT_C_RATE * view.capacity_Ah, _LIMIT_C_RATE * view.capacity_Ah),
        soc=_soc,
    ),
    twin="self_discharge",
    correction=InputCorrection(_without),
    expected=Expected(width=lambda view: 0.01 * view.capacity_Ah),
)
