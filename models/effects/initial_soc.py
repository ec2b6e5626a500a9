"""A run that did not start at the stated state of charge."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Parameter, Shift
from models.effects.expected import Expected
from models.effects.reading import Assumption
from models.effects.view import View


def _soc(view: View, change: float) -> FloatArray:
    return view.soc + change


def _voltage(view: View, change: float) -> FloatArray:
    return view.moved(soc=_soc(view, change))


def _regressors(view: View) -> FloatArray:
    return view.slope_V[:, None]


EFFECT = Effect(
    name="initial_soc",
    title="Wrong state of charge at the start",
    recognise="the error follows the slope of the open-circuit curve and is there from the first sample on",
    source="coulomb counting, ch. 2.6 of the method, eq. 2.32",
    parameters=(Parameter("soc", "1", "state of charge at the start of the first run"),),
    regressors=_regressors,
    shift=Shift(
        _voltage, lambda _view: 2e-3, lambda _view: (-0.25, 0.25), lambda view, value: view.initial_soc + value, _soc
    ),
    absorbed=True,
    assumption=Assumption(soc_moved=lambda values, first: values["soc"] - first),
    expected=Expected(width=lambda _view: 0.03),
)
