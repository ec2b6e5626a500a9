"""Temperature of the cell in degC."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.network.signals.kind import Points, Signal, SignalKind
from models.network.signals.loop_form import TEMPERATURE, LoopForm


def _temperature_degC(_signal: Signal, points: Points) -> FloatArray:
    return points.temperature_degC


def _loop(_signal: Signal, _dt_s: float, _capacity_Ah: float) -> LoopForm:
    return LoopForm(TEMPERATURE)


KIND = SignalKind(
    name="temperature",
    title="temperature of the cell in degC",
    example="temperature",
    values=_temperature_degC,
    settled=_temperature_degC,
    after_step=_temperature_degC,
    loop=_loop,
    of_temperature=True,
)
