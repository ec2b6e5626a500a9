"""Material of one electrode that takes in lithium no longer."""

from __future__ import annotations

from models.effects.effect import CURVE, Effect, Parameter
from models.effects.electrode_shift import LEFT, expected_loss, loss_shift, regressor
from models.effects.half_cells import HalfCells
from models.effects.own_electrodes import own_electrodes

# Before it shows as much in the capacity as lost lithium does, more of it has to be lost.
_USUAL = 0.08
# A curve whose steps draw together changes the more slowly the further it goes.
_STARTS = (0.0, 0.5, 1.0, 1.6, 2.3, 3.1, 4.0, 5.0)

_NEGATIVE = loss_shift(HalfCells.less_negative, " of the negative electrode")
_POSITIVE = loss_shift(HalfCells.less_positive, " of the positive electrode")
_BY_STEPS = (
    loss_shift(HalfCells.less_negative, " of the negative electrode", own_electrodes),
    loss_shift(HalfCells.less_positive, " of the positive electrode", own_electrodes),
)

EFFECT = Effect(
    name="active_material_loss",
    title="Lost active material of one electrode",
    recognise="the steps of one electrode in the open-circuit curve lie closer together than before, those of the "
    "other one as they did",
    source="Dubarry, Truchot and Liaw, J. Power Sources 219, 2012; Birkl et al., J. Power Sources 341, 2017",
    parameters=(
        Parameter("share_lost", "1", "material that is lost, over the electrode named"),
        LEFT,
    ),
    slow=True,
    regressors=regressor(_NEGATIVE),
    shift=_NEGATIVE,
    or_shifts=(_POSITIVE, *_BY_STEPS),
    absorbed=True,
    renews=(CURVE,),
    part_of=("ocv_shape",),
    expected=expected_loss(_USUAL, _STARTS),
    causes=("negative", "positive"),
)
