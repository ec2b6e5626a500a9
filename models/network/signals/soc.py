"""State of charge."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.network.signals.kind import Points, Signal, SignalKind
from models.network.signals.loop_form import SOC, LoopForm


def _soc(_signal: Signal, points: Points) -> FloatArray:
    return points.soc


def _loop(_signal: Signal, _dt_s: float, _capacity_Ah: float) -> LoopForm:
    return LoopForm(SOC)


KIND = SignalKind(
    name="soc",
    title="state of charge as a fraction",
    example="soc",
    values=_soc,
    settled=_soc,
    after_step=_soc,
    loop=_loop,
    soc=True,
)
