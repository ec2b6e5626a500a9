"""Relaxation: what is left of the current's changes; zero at rest and at constant current (eq. 2.7 of the method)."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.network.signals import filters
from models.network.signals.driven import TIME_CONSTANT
from models.network.signals.kind import Held, Run, Signal, SignalKind
from models.network.signals.loop_form import CASCADE, LoopForm


def _values(signal: Signal, run: Run) -> FloatArray:
    return filters.relaxation(run.current_A, signal.get("time_constant_s"), run.dt_s)


def _settled(_signal: Signal, points: Held) -> FloatArray:
    return np.zeros_like(points.soc)


def _loop(signal: Signal, dt_s: float, _capacity_Ah: float) -> LoopForm:
    first, second, third = filters.relaxation_poles(signal.get("time_constant_s"), dt_s).tolist()
    return LoopForm(CASCADE, poles=(first, second, third))


KIND = SignalKind(
    name="relaxation",
    title="what is left of the current's changes, in A",
    example="relaxation:300",
    parameters=(TIME_CONSTANT,),
    values=_values,
    settled=_settled,
    after_step=_values,
    loop=_loop,
    as_resistance=True,
)
