"""Resistance that differs between charge and discharge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Lean, Parameter
from models.effects.expected import Expected, Form, one_form
from models.effects.reading import Values
from models.effects.view import View
from models.network.structure import PartitionAxis, Structure

_USUAL_SHARE = 0.3


def _regressors(view: View) -> FloatArray:
    charging_A = np.maximum(view.drive_A, 0.0)
    return np.column_stack([view.overvoltage(charging_A), charging_A[view.index]])


def _columns(view: View, _shape: float) -> FloatArray:
    return view.overvoltage(np.maximum(view.drive_A, 0.0))[:, None]


def _extend(structure: Structure, _values: Values, _capacity_Ah: float) -> Structure:
    if any(axis.signal == "hysteresis" for axis in structure.axes):
        return structure
    direction = PartitionAxis("hysteresis", initial=2, splittable=False, k_sigma=0.25)
    return replace(structure, axes=(*structure.axes, direction))


def _expected(view: View) -> tuple[Form, ...]:
    return one_form(_USUAL_SHARE * _columns(view, 0.0), "ratio", "1", _USUAL_SHARE)


EFFECT = Effect(
    name="charge_discharge_asymmetry",
    title="Different resistance on charge and discharge",
    recognise="a charge pulse moves the voltage more, or less, than a discharge pulse of equal current at the same "
    "state of charge",
    source="Plett, Battery Management Systems I, 2015, ch. 2.9",
    parameters=(Parameter("ratio", "1", "change of the resistance on charge relative to the model's"),),
    shows_over=("current_A",),
    regressors=_regressors,
    overpotential=True,
    lean=Lean(_columns, lambda _view: (0.0,)),
    extend=_extend,
    bounded_part="asymmetry of charge and discharge",
    expected=Expected(_expected, share=0.25),
)
