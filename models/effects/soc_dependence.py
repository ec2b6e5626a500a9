"""Resistance that changes with the state of charge more than the model resolves."""

from __future__ import annotations

from dataclasses import replace

from models.data.timeseries import FloatArray
from models.effects.effect import AT_ONCE, Effect, Local, Parameter
from models.effects.reading import Values
from models.effects.view import View
from models.network.signals import is_soc
from models.network.structure import PartitionAxis, Structure

_BUMPS = 6
_FINER = 0.7


def _regressors(view: View) -> FloatArray:
    return view.bumps(_BUMPS) * view.drive_A[view.index, None]


def _extend(structure: Structure, _values: Values, _capacity_Ah: float) -> Structure:
    if structure.kernel == "hat":
        # Every gain of hats depends on the state of charge, from knot to knot.
        return structure
    if structure.soc_axis < 0:
        return replace(structure, axes=(PartitionAxis("soc", k_sigma=0.7), *structure.axes))
    axes = tuple(
        replace(axis, splittable=True, k_sigma=_FINER * axis.k_sigma) if is_soc(axis.signal) else axis
        for axis in structure.axes
    )
    return replace(structure, axes=axes)


EFFECT = Effect(
    name="soc_dependence",
    title="Resistance over state of charge",
    recognise="voltage jumps at a change of current are larger at some states of charge than at others, most often "
    "near empty",
    source="Plett, Battery Management Systems I, 2015, ch. 2.9; partition of the method, ch. 2.2.3.1",
    parameters=(Parameter("resistance_Ohm", "Ohm", "additional resistance at the SoC in the name"),),
    regressors=_regressors,
    overpotential=True,
    local=Local(_BUMPS),
    contains=("series_resistance",),
    extend=_extend,
    bounded_part="",
    renews=AT_ONCE,
)
