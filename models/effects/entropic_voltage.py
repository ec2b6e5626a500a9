"""Open-circuit voltage that moves with temperature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Lean, Parameter, has_signal
from models.effects.expected import Expected, Form, Told
from models.effects.reading import Values
from models.effects.view import View
from models.network.structure import InputChannel, Structure

_REFERENCE_DEGC = 25.0
_BUMPS = 6
_USUAL_V_PER_K = 2e-4


def _regressors(view: View) -> FloatArray:
    return view.bumps(_BUMPS) * _columns(view, 0.0)


def _columns(view: View, _shape: float) -> FloatArray:
    return (view.run.temperature_degC[view.index] - _REFERENCE_DEGC)[:, None]


def _extend(structure: Structure, _values: Values, _capacity_Ah: float) -> Structure:
    if has_signal(structure, "temperature"):
        return structure
    return replace(structure, inputs=(*structure.inputs, InputChannel("temperature")))


def _expected(view: View) -> tuple[Form, ...]:
    """A slope, and as much again of change along the state of charge."""
    low, high = view.model.soc_range
    along = 2.0 * (view.soc[view.index] - low) / (high - low) - 1.0
    slopes = _USUAL_V_PER_K * np.column_stack([np.ones_like(along), along])
    told = (Told("dU_dT_V_per_K", "V/K", (_USUAL_V_PER_K, 0.0)),)
    return (Form(_columns(view, 0.0) * slopes, told, dU_dT_V_per_K=slopes),)


EFFECT = Effect(
    name="entropic_voltage",
    title="Open-circuit voltage over temperature (entropy)",
    recognise="at rest the voltage follows the chamber's temperature, up or down depending on the state of charge",
    source="Bernardi, Pawlikowski and Newman, J. Electrochem. Soc. 132, 1985",
    parameters=(Parameter("dU_dT_V_per_K", "V/K", "mean slope of the open-circuit voltage over temperature"),),
    regressors=_regressors,
    lean=Lean(_columns, lambda _view: (0.0,)),
    heats_as="reversible_heat",
    like=("reversible_heat",),
    needs_temperature=True,
    reference_terms=("entropy",),
    extend=_extend,
    bounded_part="slope with temperature",
    expected=Expected(_expected),
)
