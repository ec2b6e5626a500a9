"""Low-passed current times its magnitude: an overvoltage that grows faster than the current."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.network.signals.driven import ACTIVATION, TIME_CONSTANT, drive, driven, driven_after_step, driven_form
from models.network.signals.kind import Held, Run, Signal, SignalKind, Step
from models.network.signals.loop_form import SIGNED_SQUARE, LoopForm


def _squared(x: FloatArray) -> FloatArray:
    return x * np.abs(x)


def _values(signal: Signal, run: Run) -> FloatArray:
    return _squared(driven(signal, run))


def _settled(signal: Signal, points: Held) -> FloatArray:
    return _squared(drive(signal, points))


def _after_step(signal: Signal, step: Step) -> FloatArray:
    return _squared(driven_after_step(signal, step))


def _loop(signal: Signal, dt_s: float, capacity_Ah: float) -> LoopForm:
    return driven_form(signal, dt_s, capacity_Ah, result=SIGNED_SQUARE)


KIND = SignalKind(
    name="squared_current",
    title="low-passed current times its magnitude in A^2, scaled by temperature where asked",
    example="squared_current:60/3000",
    parameters=(TIME_CONSTANT, replace(ACTIVATION, optional=True)),
    values=_values,
    settled=_settled,
    after_step=_after_step,
    loop=_loop,
)
