"""Resistance that falls with current: Butler-Volmer kinetics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Lean, Parameter, has_signal
from models.effects.expected import Expected, Form, Told
from models.effects.reading import Values
from models.effects.view import View
from models.effects.ways_in import Ground, WayIn, with_inputs
from models.network.signals import parse_signal
from models.network.structure import InputChannel, Structure

_C_RATES = (0.1, 0.3, 1.0, 3.0)
# Two electrodes with symmetric transfer have 2 R T / F each.
_LARGEST_V = 0.12
# In a measured cell it has more than one speed: at once, and slowed.
_EXCHANGE_C_RATES = (0.02, 0.2, 0.6, 2.0)
_SLOWED_S = 20.0
_SHAPES = (0.05, 0.1, 0.2, 0.35, 0.6, 1.0, 1.6, 2.5, 4.0)
# A usual change at the current of the capacity, and exchange currents over the capacity that it may have.
_USUAL_V, _EXPECTED_RATES = 0.02, (0.03, 0.1, 0.3, 1.0)


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


def _over_rates(structure: Structure, ground: Ground) -> list[Structure]:
    """At once and slowed, over exchange currents."""
    return [_at_two_speeds(structure, rate * ground.capacity_Ah, 0.0) for rate in _EXCHANGE_C_RATES]


def _over_activations(structure: Structure, ground: Ground) -> list[Structure]:
    """The same with the exchange current that was best, over what temperature does to it."""
    signals = {channel.signal: parse_signal(channel.signal) for channel in structure.inputs}
    own = {name: signal for name, signal in signals.items() if signal.kind == "charge_transfer"}
    exchange_A = next(iter(own.values())).get("exchange_current_A")
    bare = replace(structure, inputs=tuple(each for each in structure.inputs if each.signal not in own))
    return [_at_two_speeds(bare, exchange_A, activation_K) for activation_K in ground.single_activations_K]


def _at_two_speeds(structure: Structure, exchange_A: float, activation_K: float) -> Structure:
    name = f"charge_transfer:{exchange_A:.4g}/{activation_K:g}"
    return with_inputs(structure, (name, f"{name}/{_SLOWED_S:g}"))


def _expected(view: View) -> tuple[Form, ...]:
    """Curves that reach 20 mV at the current of the capacity; and those whose small currents meet what they met before.

    The latter are kinetics that bend more, or less, at the same exchange current: the curve without its tangent, of no
    larger amplitude than two electrodes have.
    """
    forms = []
    for rate in _EXPECTED_RATES:
        drive = view.run.current_A[view.index] / (2.0 * rate * view.capacity_Ah)
        at_capacity = 0.5 / rate
        whole = (np.arcsinh(drive), float(np.arcsinh(at_capacity)))
        bent = (np.arcsinh(drive) - drive, at_capacity - float(np.arcsinh(at_capacity)))
        for curve, usual in (whole, bent):
            amplitude_V = min(_USUAL_V / usual, _LARGEST_V)
            told = (Told("amplitude_V", "V", (amplitude_V,)),)
            fixed = (("exchange_current_A", "A", rate * view.capacity_Ah),)
            forms.append(Form(amplitude_V * curve[:, None], told, fixed))
    return tuple(forms)


EFFECT = Effect(
    name="charge_transfer",
    title="Charge transfer (resistance falls with current)",
    recognise="small currents meet a larger resistance than large ones: the overvoltage grows like asinh(I / 2 I0)",
    source="Newman and Thomas-Alyea, Electrochemical Systems, 2004, ch. 8, with symmetric transfer",
    parameters=(
        Parameter("amplitude_V", "V", "A in A asinh(I / 2 I0)"),
        Parameter("exchange_current_A", "A", "I0 in A asinh(I / 2 I0)"),
    ),
    shows_over=("current_A",),
    regressors=_regressors,
    overpotential=True,
    lean=Lean(_columns, _shapes, largest=_LARGEST_V),
    contains=("series_resistance",),
    reference_terms=("charge_transfer",),
    extend=_extend,
    bounded_part="charge_transfer",
    ways_in=(WayIn(_over_rates), WayIn(_over_activations)),
    expected=Expected(_expected),
)
