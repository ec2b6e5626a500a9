"""Slow diffusion: an overvoltage that dies out in minutes to hours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Lean, Parameter, Values
from models.effects.view import View
from models.network.structure import InputChannel, Structure

_TIME_CONSTANTS_S = (100.0, 300.0, 1000.0, 3000.0)
_SURFACE_S = (300.0, 1000.0, 3000.0)
_SHAPES_S = (100.0, 150.0, 220.0, 330.0, 500.0, 750.0, 1100.0, 1600.0, 2400.0, 3600.0)
_BUMPS = 5


def _regressors(view: View) -> FloatArray:
    """One time constant alone would leave to hysteresis what a spread of them explains."""
    bumps = view.bumps(_BUMPS)
    columns = [bumps * view.low_pass(view.drive_A, tau_s)[:, None] for tau_s in _TIME_CONSTANTS_S]
    surface = [view.slope_V * view.low_pass(view.drive_A, tau_s) / view.capacity_Ah for tau_s in _SURFACE_S]
    return np.column_stack([*columns, *surface])


def _columns(view: View, time_constant_s: float) -> FloatArray:
    return view.low_pass(view.drive_A, time_constant_s)[:, None]


def _extend(structure: Structure, values: Values, _capacity_Ah: float) -> Structure:
    tau_s = values.get("time_constant_s", 600.0)
    return replace(structure, inputs=(*structure.inputs, InputChannel(f"low_pass:{tau_s:.4g}")))


EFFECT = Effect(
    name="relaxation",
    title="Slow relaxation (diffusion)",
    recognise="after the current stops the voltage goes on creeping for minutes to hours, and under a long pulse it "
    "goes on falling",
    source="Plett, Battery Management Systems I, 2015, ch. 2.4 and 2.7; the method's relaxation input, eq. 2.7",
    parameters=(
        Parameter("resistance_Ohm", "Ohm", "additional resistance in the end"),
        Parameter("time_constant_s", "s", "time in which it dies out to 37 %"),
    ),
    regressors=_regressors,
    overpotential=True,
    lean=Lean(_columns, lambda _view: _SHAPES_S),
    extend=_extend,
)
