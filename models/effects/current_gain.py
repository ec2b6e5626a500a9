"""A current sensor that reads a constant share too much."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Parameter, Shift
from models.effects.expected import Expected
from models.effects.reading import InputCorrection, Reading, Values
from models.effects.view import View

_STEP, _LIMIT = 1e-3, 0.3
# Cyclers are specified to 0.02 to 0.1 % of their range, simple ones and a shunt that has aged to half a per cent. More
# than a tenth is a wrong range.
_USUAL, _FURTHEST = 0.004, 25.0


def _soc(view: View, gain: float) -> FloatArray:
    return view.initial_soc + (view.soc - view.initial_soc) / (1.0 + gain)


def _true_A(view: View, gain: float) -> FloatArray:
    return view.run.current_A / (1.0 + gain)


def _voltage(view: View, gain: float) -> FloatArray:
    """Simulated with the true current: charge and load are less than was read, both by the same share."""
    return view.moved(soc=_soc(view, gain), current_A=_true_A(view, gain))


def _regressors(view: View) -> FloatArray:
    return _voltage(view, _STEP)[:, None] / _STEP


def _without(read: Reading, values: Values) -> Reading:
    return read._replace(current_A=read.current_A / (1.0 + values["gain"]))


EFFECT = Effect(
    name="current_gain",
    title="Gain of the current sensor",
    recognise="the error grows with the charge taken out and goes back when it is put in again, as with another "
    "capacity, and all overvoltages are too small or too large by the same share at once",
    source="sensor model, constant gain",
    parameters=(Parameter("gain", "1", "share that the sensor reads too much"),),
    slow=True,
    regressors=_regressors,
    shift=Shift(_voltage, lambda _view: _STEP, lambda _view: (-_LIMIT, _LIMIT), soc=_soc, current_A=_true_A),
    absorbed=True,
    like=("capacity",),
    correction=InputCorrection(_without, possible=lambda values: values["gain"] > -1.0),
    # A cell that has aged is more usual than a sensor that has, and in many a log the two look alike.
    expected=Expected(width=lambda _view: _USUAL, furthest=_FURTHEST, share=0.3, learned=False),
)
