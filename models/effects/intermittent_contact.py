"""A contact or cable resistance that comes and goes."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.contact_intervals import bad_contact, smallest_found_Ohm
from models.effects.effect import Effect, Parameter
from models.effects.expected import Expected, Form, one_form
from models.effects.reading import Values
from models.effects.view import View

# A usual bad contact, relative to the cell's own resistance.
_USUAL_SHARE = 0.3
# Where a record shows none, as on a profile that is yet to be played, it is thought to be bad for so long at a time.
_AWAY_S = 900.0
# Parts of that by which the intervals may lie elsewhere.
_PHASES = (0.0, 0.5, 1.0, 1.5)


def _while_bad_A(view: View, bad: np.ndarray) -> FloatArray:
    return np.where(bad, view.run.current_A, 0.0)[view.index, None]


def _regressors(view: View) -> FloatArray:
    bad = bad_contact(view)
    return _while_bad_A(view, bad if bad.any() else _now_and_then(view))


def _now_and_then(view: View, phase: float = 0.0) -> np.ndarray:
    """(n,) when a contact might have been bad."""
    away_s = min(_AWAY_S, float(view.run.time_s[-1]) / 3.0)
    return np.floor(view.run.time_s / max(away_s, 1e-9) + phase) % 2 == 1


def _form(view: View, bad: np.ndarray) -> tuple[Form, ...]:
    usual_Ohm = _USUAL_SHARE * view.model.typical_Ohm
    return one_form(usual_Ohm * _while_bad_A(view, bad), "resistance_Ohm", "Ohm", usual_Ohm)


def _fault_V(view: View, values: Values) -> FloatArray:
    return np.where(bad_contact(view), values["resistance_Ohm"] * view.run.current_A, 0.0)


EFFECT = Effect(
    name="intermittent_contact",
    title="Contact that comes and goes",
    recognise="for some minutes, now and then, the voltage jumps more at each step of the current, or jumps under a "
    "steady current, and is right again afterwards",
    source="Plett, Battery Management Systems I, 2015, ch. 2.3; intervals by change points, Viterbi 1967",
    parameters=(Parameter("resistance_Ohm", "Ohm", "additional resistance while the contact is bad"),),
    shows_over=("time_h", "current_A"),
    regressors=_regressors,
    absorbed=True,
    fault_V=_fault_V,
    # The intervals are looked for in the error itself: chance has many to choose from.
    expected=Expected(
        lambda view: _form(view, bad_contact(view)),
        share=0.1,
        learned=False,
        unseen=lambda view: _form(view, _now_and_then(view)),
        found_from=lambda view: smallest_found_Ohm(view, [_now_and_then(view, phase) for phase in _PHASES]),
    ),
)
