"""Resistance that changes with temperature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import LINEAR, Effect, Parameter, Shift
from models.effects.expected import Expected
from models.effects.reading import Values
from models.effects.view import View
from models.network.signals import parse_signal
from models.network.structure import InputChannel, PartitionAxis, Structure

_ACTIVATION_K = (2000.0, 6000.0)
_SCALED = {"current": "scaled_current", "scaled_current": "scaled_current"}
# A usual change. Training runs that span less than this in K hardly tell how resistances go with temperature: that part
# of a usual change is no news then.
_USUAL_K, _SPAN_K, _UNTOLD = 1000.0, 10.0, 0.3


def _warmer_A(view: View, activation_K: float) -> FloatArray:
    """Change of the scaled current by a change of the activation temperature."""
    return view.drive_A * np.expm1(activation_K * view.inverse_temperature)


def _regressors(view: View) -> FloatArray:
    columns = []
    for activation_K in _ACTIVATION_K:
        change_A = _warmer_A(view, activation_K)
        columns += [view.overvoltage(change_A), change_A[view.index]]
    return np.column_stack(columns)


def _voltage(view: View, activation_K: float) -> FloatArray:
    return view.overvoltage(_warmer_A(view, activation_K))


def _granted(view: View) -> float:
    low, high = view.model.domain.get("temperature_degC", (25.0, 25.0))
    return _UNTOLD if high - low < _SPAN_K else 0.0


def _extend(structure: Structure, values: Values, _capacity_Ah: float) -> Structure:
    """Scale the currents by temperature; with output feedback, partition in temperature instead."""
    if structure.output_order > 0:
        if any("temperature" in axis.signal for axis in structure.axes):
            return structure
        axis = PartitionAxis("inverse_temperature", initial=3, splittable=False, k_sigma=1.0)
        return replace(structure, axes=(*structure.axes, axis))
    change_K = values.get("activation_K", 2500.0)
    return replace(structure, inputs=tuple(_scaled(channel, change_K) for channel in structure.inputs))


def _scaled(channel: InputChannel, change_K: float) -> InputChannel:
    signal = parse_signal(channel.signal)
    own_K = signal.get("activation_K") + change_K
    if signal.kind in _SCALED:
        return replace(channel, signal=f"scaled_current:{own_K:.5g}")
    if signal.kind == "low_pass":
        return replace(channel, signal=f"low_pass:{signal.get('time_constant_s'):g}/{own_K:.5g}")
    if signal.kind == "charge_transfer":
        end = f"/{signal.get('time_constant_s'):g}" if signal.get("time_constant_s") else ""
        return replace(channel, signal=f"charge_transfer:{signal.get('exchange_current_A'):g}/{own_K:.5g}{end}")
    return channel


EFFECT = Effect(
    name="temperature_dependence",
    title="Resistance over temperature (Arrhenius)",
    recognise="the cold cell shows larger, the warm cell smaller overvoltages than the model",
    source="Plett, Battery Management Systems I, 2015, ch. 2; Arrhenius law",
    parameters=(Parameter("activation_K", "K", "change of the activation energy over the gas constant"),),
    shows_over=("temperature_degC",),
    regressors=_regressors,
    overpotential=True,
    shift=Shift(_voltage, lambda _view: 50.0, lambda _view: (-7000.0, 9000.0), searched=False),
    needs_temperature=True,
    reference_terms=("warm_current",),
    activation_K=lambda values: values["activation_K"],
    extend=_extend,
    bounded_part="scaling by temperature",
    renews=LINEAR,
    expected=Expected(width=lambda _view: _USUAL_K, starts=(0.0,), granted=_granted),
)
