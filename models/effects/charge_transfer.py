"""Resistance that falls with current: Butler-Volmer kinetics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Lean, Parameter, Values, has_signal
from models.effects.view import View
from models.network.structure import InputChannel, Structure

_C_RATES = (0.1, 0.3, 1.0, 3.0)
# Two electrodes with symmetric transfer have 2 R T / F each.
_LARGEST_V = 0.12
_SHAPES = (0.05, 0.1, 0.2, 0.35, 0.6, 1.0, 1.6, 2.5, 4.0)


def _regressors(view: View) -> FloatArray:
    drive_A = view.drive_A[view.index]
    curves = [np.arcsinh(drive_A / (rate * view.capacity_Ah)) for rate in _C_RATES]
    return np.column_stack([drive_A, *curves])


def _columns(view: View, exchange_A: float) -> FloatArray:
    drive_A = view.drive_A[view.index]
    return np.column_stack([np.arcsinh(drive_A / (2.0 * exchange_A)), drive_A])


def _shapes(view: View) -> tuple[float, ...]:
    return tuple(rate * view.capacity_Ah for rate in _SHAPES)


def _extend(structure: Structure, values: Values, capacity_Ah: float) -> Structure:
    if has_signal(structure, "charge_transfer"):
        return structure
    exchange_A = 2.0 * values.get("exchange_current_A", 0.6 * capacity_Ah)
    return replace(structure, inputs=(*structure.inputs, InputChannel(f"charge_transfer:{exchange_A:.4g}")))


EFFECT = Effect(
    name="charge_transfer",
    title="Charge transfer (resistance falls with current)",
    recognise="small currents meet a larger resistance than large ones: the overvoltage grows like asinh(I / 2 I0)",
    source="Newman and Thomas-Alyea, Electrochemical Systems, 2004, ch. 8, with symmetric transfer",
    parameters=(
        Parameter("amplitude_V", "V", "A in A asinh(I / 2 I0)"),
        Parameter("exchange_current_A", "A", "I0 in A asinh(I / 2 I0)"),
    ),
    regressors=_regressors,
    overpotential=True,
    lean=Lean(_columns, _shapes, largest=_LARGEST_V),
    contains=("series_resistance",),
    extend=_extend,
)
