"""Temperature of the cell in degC; beyond a range that is given, ever less of what is beyond."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.network.signals.kind import Parameter, Points, Signal, SignalKind
from models.network.signals.loop_form import TEMPERATURE, LoopForm
from models.network.signals.temperature_scale import within_degC


def signal_within(low_degC: float, high_degC: float) -> str:
    """Name of the temperature that hardly goes beyond those of some runs."""
    return f"temperature:{np.floor(10.0 * low_degC) / 10.0:.1f}/{np.ceil(10.0 * high_degC) / 10.0:.1f}"


def _range_degC(signal: Signal) -> tuple[float, float]:
    """Lowest and highest temperature that is taken as it is."""
    return signal.parameters.get("low_degC", -np.inf), signal.parameters.get("high_degC", np.inf)


def _temperature_degC(signal: Signal, points: Points) -> FloatArray:
    low_degC, high_degC = _range_degC(signal)
    beyond = np.flatnonzero((points.temperature_degC < low_degC) | (points.temperature_degC > high_degC))
    out = points.temperature_degC.copy()
    out[beyond] = [within_degC(degC, low_degC, high_degC) for degC in out[beyond]]
    return out


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
