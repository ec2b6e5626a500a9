"""Charge that leaks away inside the cell."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Parameter, Shift
from models.effects.view import View

_STEP_C_RATE = 2e-4
_LIMIT_C_RATE = 0.05


def _soc(view: View, leakage_A: float) -> FloatArray:
    return view.soc - leakage_A * view.run.time_s / (3600.0 * view.capacity_Ah)


def _voltage(view: View, leakage_A: float) -> FloatArray:
    return view.moved(soc=_soc(view, leakage_A))


def _step(view: View) -> float:
    return _STEP_C_RATE * view.capacity_Ah


def _regressors(view: View) -> FloatArray:
    return _voltage(view, _step(view))[:, None] / _step(view)


EFFECT = Effect(
    name="self_discharge",
    title="Self-discharge",
    recognise="the error grows with time, at rest too, and towards a lower state of charge",
    source="charge balance of a cell with an internal leak",
    parameters=(Parameter("leakage_A", "A", "internal current that discharges the cell"),),
    regressors=_regressors,
    shift=Shift(
        _voltage,
        _step,
        lambda view: (-_LIMIT_C_RATE * view.capacity_Ah, _LIMIT_C_RATE * view.capacity_Ah),
        soc=_soc,
    ),
    twin="current_offset",
)
