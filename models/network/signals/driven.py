"""What kinds that the current drives are made with: scaled by temperature, through asinh, through a low-pass.

The constants are parameters of the signal under these names; one that its kind has not is 0 and leaves its part out.
"""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.network.signals.filters import low_pass
from models.network.signals.kind import Parameter, Points, Run, Signal, Step
from models.network.signals.loop_form import AS_IS, DRIVEN, LoopForm
from models.network.signals.temperature_scale import arrhenius

TIME_CONSTANT = Parameter("time_constant_s", "s")
ACTIVATION = Parameter("activation_K", "K", positive=False)
EXCHANGE_CURRENT = Parameter("exchange_current_A", "A")


def drive(signal: Signal, points: Points) -> FloatArray:
    """(n,) current as a signal takes it in: scaled by temperature and through asinh where asked, before any filter."""
    activation_K, exchange_A = signal.get("activation_K"), signal.get("exchange_current_A")
    # A network has a few dozen signals that differ in their filter alone.
    if (activation_K, exchange_A) not in points.driven:
        x = points.current_A
        if activation_K:
            x = x * arrhenius(points.temperature_degC, activation_K)
        points.driven[activation_K, exchange_A] = np.arcsinh(x / exchange_A) if exchange_A else x
    return points.driven[activation_K, exchange_A]


def slowed(signal: Signal, x: FloatArray, dt_s: float) -> FloatArray:
    """(n,) low-pass of what a signal took in, starting at rest."""
    return low_pass(x, signal.get("time_constant_s"), dt_s) if signal.get("time_constant_s") else x


def slowed_from_first(signal: Signal, x: FloatArray, dt_s: float) -> FloatArray:
    """(n,) the same, but settled at the first value."""
    return x[0] + slowed(signal, x - x[0], dt_s)


def driven(signal: Signal, run: Run) -> FloatArray:
    """(n,) what a signal took in, low-passed, over a run."""
    return slowed(signal, drive(signal, run), run.dt_s)


def driven_after_step(signal: Signal, step: Step) -> FloatArray:
    """(n,) the same around a step of the current."""
    if not signal.get("time_constant_s"):
        return drive(signal, step)
    return slowed_from_first(signal, drive(signal, step), step.dt_s)


def driven_form(signal: Signal, dt_s: float, _capacity_Ah: float, entry: int = AS_IS, result: int = AS_IS) -> LoopForm:
    """Row for the compiled loops; `entry` and `result` as in `LoopForm`."""
    tau_s = signal.get("time_constant_s")
    return LoopForm(
        DRIVEN,
        entry,
        result,
        poles=(float(np.exp(-dt_s / tau_s)) if tau_s else 0.0, 0.0, 0.0),
        activation_K=signal.get("activation_K"),
        exchange_A=signal.get("exchange_current_A"),
    )
