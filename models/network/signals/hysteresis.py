"""Direction of the last current, held through rests (ch. 2.2.3.1 of the method)."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.network.signals.direction import REST_C_RATE, held_sign
from models.network.signals.kind import Held, Run, Signal, SignalKind, Step
from models.network.signals.loop_form import DIRECTION, LoopForm


def _values(_signal: Signal, run: Run) -> FloatArray:
    return held_sign(run.current_A, REST_C_RATE * run.capacity_Ah)


def _direction(_signal: Signal, points: Held | Step) -> FloatArray:
    return points.direction


def _loop(_signal: Signal, _dt_s: float, _capacity_Ah: float) -> LoopForm:
    return LoopForm(DIRECTION)


KIND = SignalKind(
    name="hysteresis",
    title="direction of the last current, +1 or -1",
    example="hysteresis",
    values=_values,
    settled=_direction,
    after_step=_direction,
    loop=_loop,
)
