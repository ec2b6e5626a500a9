"""A capacity that differs from the assumed one."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Parameter, Shift
from models.effects.expected import Expected
from models.effects.reading import Assumption
from models.effects.view import View

_STEP = 0.01


def _soc(view: View, change: float) -> FloatArray:
    """SoC counted on the capacity times 1 + change; the run's initial SoC is a fraction of the new capacity."""
    return view.initial_soc + (view.soc - view.initial_soc) / (1.0 + change)


def _voltage(view: View, change: float) -> FloatArray:
    return view.moved(soc=_soc(view, change))


def _regressors(view: View) -> FloatArray:
    return _voltage(view, _STEP)[:, None] / _STEP


EFFECT = Effect(
    name="capacity",
    title="Capacity",
    recognise="the error grows with the charge taken out since the start and goes back when it is put in again",
    source="coulomb counting, ch. 2.6 of the method, eq. 2.32",
    parameters=(Parameter("capacity_Ah", "Ah", "capacity of the cell"),),
    slow=True,
    regressors=_regressors,
    shift=Shift(
        _voltage,
        lambda _view: 5e-3,
        lambda _view: (-0.5, 0.5),
        lambda view, value: view.capacity_Ah * (1.0 + value),
        _soc,
    ),
    absorbed=True,
    assumption=Assumption(capacity_Ah=lambda values: values["capacity_Ah"]),
    # Counted charge is right to half a per cent, from one bench or day to the next.
    expected=Expected(width=lambda _view: 0.05, granted=lambda _view: 0.1),
    life="capacity",
)
