"""Inverse temperature in 1/K: what the logarithm of a thermally activated resistance is linear in."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.network.signals.kind import Points, Signal, SignalKind
from models.network.signals.loop_form import INVERSE_TEMPERATURE, LoopForm
from models.network.signals.temperature_scale import KELVIN


def _per_kelvin(_signal: Signal, points: Points) -> FloatArray:
    return 1.0 / (points.temperature_degC + KELVIN)


def _loop(_signal: Signal, _dt_s: float, _capacity_Ah: float) -> LoopForm:
    return LoopForm(INVERSE_TEMPERATURE)


KIND = SignalKind(
    name="inverse_temperature",
    title="inverse temperature of the cell in 1/K",
    example="inverse_temperature",
    values=_per_kelvin,
    settled=_per_kelvin,
    after_step=_per_kelvin,
    loop=_loop,
    of_temperature=True,
)
