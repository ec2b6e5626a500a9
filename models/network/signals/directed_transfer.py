"""Charge transfer in one direction: where transfer is not symmetric, charge and discharge lose unequal voltages.

Newman and Thomas-Alyea, "Electrochemical Systems", 2004, ch. 8, for transfer coefficients that are not one half.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.network.signals.driven import (
    ACTIVATION,
    EXCHANGE_CURRENT,
    TIME_CONSTANT,
    drive,
    driven_form,
    slowed,
    slowed_from_first,
)
from models.network.signals.kind import Held, Parameter, Points, Run, Signal, SignalKind, Step
from models.network.signals.loop_form import CHARGE, DISCHARGE, LoopForm


def _charges(signal: Signal) -> bool:
    return signal.get("direction") > 0.0


def _one_way(signal: Signal, points: Points) -> FloatArray:
    """(n,) what the current does while it flows in the signal's direction."""
    x = drive(signal, points)
    return np.maximum(x, 0.0) if _charges(signal) else np.minimum(x, 0.0)


def _values(signal: Signal, run: Run) -> FloatArray:
    return slowed(signal, _one_way(signal, run), run.dt_s)


def _settled(signal: Signal, points: Held) -> FloatArray:
    return _one_way(signal, points)


def _after_step(signal: Signal, step: Step) -> FloatArray:
    x = _one_way(signal, step)
    return slowed_from_first(signal, x, step.dt_s) if signal.get("time_constant_s") else x


def _loop(signal: Signal, dt_s: float, capacity_Ah: float) -> LoopForm:
    return driven_form(signal, dt_s, capacity_Ah, entry=CHARGE if _charges(signal) else DISCHARGE)


KIND = SignalKind(
    name="directed_transfer",
    title="asinh of the current over an exchange current while the cell charges (1) or discharges (-1)",
    example="directed_transfer:-1/3/2500/20",
    parameters=(
        Parameter("direction", "1", positive=False),
        EXCHANGE_CURRENT,
        replace(ACTIVATION, optional=True),
        replace(TIME_CONSTANT, optional=True),
    ),
    values=_values,
    settled=_settled,
    after_step=_after_step,
    loop=_loop,
    as_resistance=True,
)
