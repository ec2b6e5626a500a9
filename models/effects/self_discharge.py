"""Charge that leaks away inside the cell."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Parameter, Shift
from models.effects.expected import Expected
from models.effects.reading import InputCorrection, Reading, Values
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


def _inner_heat_W(open_circuit_V: FloatArray) -> FloatArray:
    """All that 1 A through the leak gives off stays in the cell."""
    return open_circuit_V


def _without(read: Reading, values: Values) -> Reading:
    """What charges the cell is what the sensor reads less what leaks."""
    return read._replace(current_A=read.current_A - values["leakage_A"])


EFFECT = Effect(
    name="self_discharge",
    title="Self-discharge",
    recognise="the error grows with time, at rest too, and towards a lower state of charge",
    source="charge balance of a cell with an internal leak",
    parameters=(Parameter("leakage_A", "A", "internal current that discharges the cell"),),
    shows_over=("time_h",),
    slow=True,
    regressors=_regressors,
    shift=Shift(
        _voltage,
        _step,
        lambda view: (-_LIMIT_C_RATE * view.capacity_Ah, _LIMIT_C_RATE * view.capacity_Ah),
        soc=_soc,
    ),
    inner_heat_W=_inner_heat_W,
    twin="current_offset",
    correction=InputCorrection(_without),
    expected=Expected(width=lambda view: 0.01 * view.capacity_Ah),
)
