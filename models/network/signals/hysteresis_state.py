"""One-state hysteresis: it follows the current's direction with the charge that flows (Plett, 2015, ch. 2)."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.network.signals import direction
from models.network.signals.kind import Held, Parameter, Run, Signal, SignalKind, Step
from models.network.signals.loop_form import LOOP, LoopForm


def _values(signal: Signal, run: Run) -> FloatArray:
    return direction.hysteresis_state(run.current_A, signal.get("rate"), run.dt_s, run.capacity_Ah)


def _settled(_signal: Signal, points: Held) -> FloatArray:
    return points.direction


def _after_step(signal: Signal, step: Step) -> FloatArray:
    before, turned = step.direction[0], step.direction[-1]
    per_sample = step.current_A[-1] * step.dt_s / (3600.0 * step.capacity_Ah)
    return turned + (before - turned) * np.exp(-signal.get("rate") * abs(per_sample) * step.since)


def _loop(signal: Signal, dt_s: float, capacity_Ah: float) -> LoopForm:
    return LoopForm(LOOP, factor=signal.get("rate") * (dt_s / (3600.0 * capacity_Ah)))


KIND = SignalKind(
    name="hysteresis_state",
    title="state between -1 and 1 that follows the current's direction with the charge that flows",
    example="hysteresis_state:40",
    parameters=(Parameter("rate", "1"),),
    values=_values,
    settled=_settled,
    after_step=_after_step,
    loop=_loop,
)
