"""Temperature of the cell in degC; beyond a range that is given, ever less of what is beyond."""

from __future__ import annotations

import numpy as np

from models.data.errors import StructureError
from models.data.timeseries import FloatArray
from models.network.signals.kind import Parameter, Points, Signal, SignalKind
from models.network.signals.loop_form import TEMPERATURE, LoopForm
from models.network.signals.temperature_scale import FURTHEST_K


def signal_within(low_degC: float, high_degC: float) -> str:
    """Name of the temperature that hardly goes beyond those of some runs."""
    return f"temperature:{np.floor(10.0 * low_degC) / 10.0:.1f}/{np.ceil(10.0 * high_degC) / 10.0:.1f}"


def _range_degC(signal: Signal) -> tuple[float, float]:
    """Lowest and highest temperature that is taken as it is; raises StructureError where they are exchanged."""
    low_degC, high_degC = signal.parameters.get("low_degC", -np.inf), signal.parameters.get("high_degC", np.inf)
    if low_degC > high_degC:
        raise StructureError(f"signal {signal.name!r}: low_degC is above high_degC")
    return low_degC, high_degC


def _temperature_degC(signal: Signal, points: Points) -> FloatArray:
    """`within_degC` of many at once."""
    inside = np.clip(points.temperature_degC, *_range_degC(signal))
    beyond = points.temperature_degC - inside
    return inside - FURTHEST_K * np.sign(beyond) * np.expm1(-np.abs(beyond) / FURTHEST_K)


def _loop(signal: Signal, _dt_s: float, _capacity_Ah: float) -> LoopForm:
    return LoopForm(TEMPERATURE, poles=(*_range_degC(signal), 0.0))


KIND = SignalKind(
    name="temperature",
    title="temperature of the cell in degC",
    example="temperature:5/45",
    parameters=(
        Parameter("low_degC", "°C", optional=True, positive=False),
        Parameter("high_degC", "°C", optional=True, positive=False),
    ),
    values=_temperature_degC,
    settled=_temperature_degC,
    after_step=_temperature_degC,
    loop=_loop,
    of_temperature=True,
)
