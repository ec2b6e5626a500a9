"""A contact or cable resistance outside the cell."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.effects.effect import AT_ONCE, Effect, Parameter
from models.effects.view import View


def _regressors(view: View) -> FloatArray:
    return view.run.current_A[view.index, None]


EFFECT = Effect(
    name="series_resistance",
    title="Contact or cable resistance",
    recognise="the voltage jumps by the same amount for each ampere at every state of charge, temperature and current, "
    "and the jump is there at once",
    source="Plett, Battery Management Systems I, 2015, ch. 2.3",
    parameters=(Parameter("resistance_Ohm", "Ohm", "additional resistance"),),
    shows_over=("current_A",),
    regressors=_regressors,
    absorbed=True,
    renews=AT_ONCE,
)
