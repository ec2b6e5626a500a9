"""An open-circuit curve that has moved."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import CURVE, Effect, Local, Parameter
from models.effects.expected import Expected, Form, Told, alike
from models.effects.spline import SplineBasis
from models.effects.view import View

_BUMPS = 16
# A usual change, over how much SoC it bends, and where along the trained range it is told.
_USUAL_V, _BENDS_OVER, _TOLD_AT = 0.01, 0.12, (0.1, 0.3, 0.5, 0.7, 0.9)


def _regressors(view: View) -> FloatArray:
    return view.bumps(_BUMPS)


def _expected(view: View) -> tuple[Form, ...]:
    """A curve of 10 mV that bends over 0.12 of the state of charge."""
    low, high = view.model.soc_range
    basis = SplineBasis(low, high, _BUMPS)
    root = _USUAL_V * alike(basis.centres, _BENDS_OVER)
    points = low + np.array(_TOLD_AT) * (high - low)
    rows = 1e3 * basis.matrix(points) @ root
    told = tuple(
        Told(f"shift_mV at SoC {soc:.2f}", "mV", tuple(row.tolist())) for soc, row in zip(points, rows, strict=True)
    )
    return (Form(_regressors(view) @ root, told),)


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
    expected=Expected(_expected, share=0.1),
    life="curve",
)
