"""A contact or cable resistance outside the cell."""

from __future__ import annotations

from models.data.timeseries import FloatArray
from models.effects.effect import AT_ONCE, Effect, Parameter
from models.effects.expected import Expected, Form, one_form
from models.effects.view import View

# A usual change, relative to the cell's own resistance.
_USUAL_SHARE = 0.3


def _regressors(view: View) -> FloatArray:
    return view.run.current_A[view.index, None]


def _expected(view: View) -> tuple[Form, ...]:
    usual_Ohm = _USUAL_SHARE * view.model.typical_Ohm
    return one_form(usual_Ohm * _regressors(view), "resistance_Ohm", "Ohm", usual_Ohm)


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
    expected=Expected(_expected, heat_shares=(0.0, 1.0)),
)
