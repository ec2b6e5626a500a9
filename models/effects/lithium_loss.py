"""Lithium that can no longer be cycled: the electrodes have slipped against each other."""

from __future__ import annotations

from models.effects.effect import CURVE, Effect, Parameter
from models.effects.electrode_shift import LEFT, expected_loss, loss_shift, regressor
from models.effects.half_cells import HalfCells
from models.effects.own_electrodes import own_electrodes

# As large as a usual change of the capacity, which it makes.
_USUAL = 0.05
# A curve with steps that slips changes the more slowly the further it goes: a search needs more places to begin.
_STARTS = (0.0, 0.5, 1.0, 1.6, 2.3, 3.1, 4.0, 5.0, 6.5)

_SHIFT = loss_shift(HalfCells.less_lithium)
_BY_STEPS = loss_shift(HalfCells.less_lithium, apart=own_electrodes)

EFFECT = Effect(
    name="lithium_loss",
    title="Lost lithium (slipped electrodes)",
    recognise="the cell holds less, and the steps of the negative electrode in the open-circuit curve lie at a lower "
    "state of charge than before, while those of the positive one stay",
    source="Dubarry, Truchot and Liaw, J. Power Sources 219, 2012; Birkl et al., J. Power Sources 341, 2017",
    parameters=(
        Parameter("share_lost", "1", "lithium that is lost, over the fresh capacity"),
        LEFT,
    ),
    slow=True,
    regressors=regressor(_SHIFT),
    shift=_SHIFT,
    or_shifts=(_BY_STEPS,),
    absorbed=True,
    renews=(CURVE,),
    # Steps that all lie as much charge further on are those of a run that begins elsewhere; the positive electrode,
    # which stays behind, makes little more than a constant where its curve is flat.
    seems=(frozenset({"initial_soc", "voltage_offset"}), frozenset({"initial_soc", "voltage_gain"})),
    part_of=("ocv_shape",),
    expected=expected_loss(_USUAL, _STARTS),
    causes=("lithium",),
)
