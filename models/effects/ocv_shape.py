"""An open-circuit curve that has moved."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.effects.effect import CURVE, Effect, Local, Parameter
from models.effects.view import View

_BUMPS = 16


def _regressors(view: View) -> FloatArray:
    return view.bumps(_BUMPS)


EFFECT = Effect(
    name="ocv_shape",
    title="Moved open-circuit curve",
    recognise="the error at rest depends on the state of charge alone, and is the same in both directions: electrodes "
    "have slipped, lithium was lost",
    source="Dubarry, Truchot and Liaw, J. Power Sources 219, 2012",
    parameters=(Parameter("shift_mV", "mV", "change of the open-circuit voltage at the SoC in the name"),),
    slow=True,
    regressors=_regressors,
    local=Local(_BUMPS, scale=1e3),
    absorbed=True,
    renews=(CURVE,),
    contains=("voltage_offset", "initial_soc", "capacity"),
)
