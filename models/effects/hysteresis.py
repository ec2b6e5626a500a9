"""Voltage hysteresis: the rest voltage depends on the direction of the last current."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Lean, Parameter, has_signal
from models.effects.expected import Expected, Form, Told
from models.effects.reading import Values
from models.effects.view import View
from models.network.structure import InputChannel, Structure

_RATES = (5.0, 15.0, 50.0, 150.0)
_SHAPES = (4.0, 6.0, 9.0, 14.0, 20.0, 30.0, 45.0, 70.0, 110.0, 170.0, 400.0)
_BUMPS = 5
# A usual loop, the widest of any cell, which silicon has when nearly empty, and rates that it may have.
_USUAL_V, _MOST_V, _EXPECTED_RATES = 0.008, 0.3, (10.0, 20.0, 40.0, 80.0, 160.0)
# Silicon beside graphite has a loop of its own, but takes part only where the cell is nearly empty (Ai et al., J. Power
# Sources 527, 2022): how fast that fades with the state of charge, and rates that it may have there.
_SILICON_SOC, _SILICON_RATES = 0.1, (5.0, 10.0, 20.0)


def _regressors(view: View) -> FloatArray:
    """The sign-held form alone is taken for relaxation where the true one is gradual."""
    bumps = view.bumps(_BUMPS)
    return np.column_stack([bumps * view.hysteresis(rate)[:, None] for rate in _RATES])


def _columns(view: View, rate: float) -> FloatArray:
    return view.hysteresis(rate)[:, None]


def _extend(structure: Structure, values: Values, _capacity_Ah: float) -> Structure:
    if has_signal(structure, "hysteresis_state"):
        return structure
    rate = values.get("rate", 40.0)
    return replace(structure, inputs=(*structure.inputs, InputChannel(f"hysteresis_state:{rate:.4g}")))


def _expected(view: View) -> tuple[Form, ...]:
    """A loop of 8 mV, and as much again of change along the state of charge; or one that is wide near empty alone."""
    low, high = view.model.soc_range
    along = 2.0 * (view.soc[view.index] - low) / (high - low) - 1.0
    # A loop can close, but not turn inside out.
    least = -float(np.mean(view.model.loop_V(view.soc[view.index]))) / _USUAL_V
    forms = []
    for rate in _EXPECTED_RATES:
        loop_V = _USUAL_V * view.hysteresis(rate)
        told = (Told("amplitude_V", "V", (_USUAL_V, 0.0)),)
        forms.append(Form(np.column_stack([loop_V, along * loop_V]), told, (("rate", "1", rate),), least))
    near_empty = np.exp(1.0 - np.maximum(view.soc[view.index], 0.0) / _SILICON_SOC)
    for rate in _SILICON_RATES:
        loop_V = _USUAL_V * near_empty * view.hysteresis(rate)
        told = (Told("amplitude_V", "V", (_USUAL_V,)),)
        fixed = (("rate", "1", rate), ("amplitude_at_soc", "1", _SILICON_SOC))
        forms.append(Form(loop_V[:, None], told, fixed, least))
    return tuple(forms)


EFFECT = Effect(
    name="hysteresis",
    title="Voltage hysteresis",
    recognise="after the same rest at the same state of charge the voltage is higher when the cell was charged last "
    "than when it was discharged last, and it stays so",
    source="Plett, Battery Management Systems I, 2015, ch. 2.8 (one-state model)",
    parameters=(
        Parameter("amplitude_V", "V", "half the width of the loop"),
        Parameter("rate", "1", "the loop closes to 37 % after capacity / rate of charge"),
    ),
    shows_over=("soc_at_rest", "soc"),
    slow=True,
    regressors=_regressors,
    overpotential=True,
    lean=Lean(_columns, lambda _view: _SHAPES, possible=lambda _view: _MOST_V),
    reference_terms=("hysteresis",),
    extend=_extend,
    bounded_part="hysteresis",
    read_out=("hysteresis_V", 0.5),
    expected=Expected(_expected),
    like=("ocv_shape",),
)
