"""Resistance that grows with charge throughput."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import LINEAR, Effect, Lean, Parameter
from models.effects.expected import Expected, Form, one_form
from models.effects.view import View

# A usual growth over so many full charges; and what a cell may lose with a single one: more is no ageing, but a
# resistance over the state of charge, which falls as charge is moved.
_USUAL_GROWTH, _USUAL_THROUGHPUT = 0.3, 5.0
_MOST_A_CHARGE = 0.3


def _grown_A(view: View) -> FloatArray:
    return view.drive_A * view.throughput_Ah


def _regressors(view: View) -> FloatArray:
    grown_A = _grown_A(view)
    return np.column_stack([view.overvoltage(grown_A), grown_A[view.index]])


def _columns(view: View, _shape: float) -> FloatArray:
    return view.overvoltage(_grown_A(view))[:, None]


def _expected(view: View) -> tuple[Form, ...]:
    usual = _USUAL_GROWTH / (_USUAL_THROUGHPUT * view.capacity_Ah)
    return one_form(usual * _columns(view, 0.0), "growth_per_Ah", "1/Ah", usual)


EFFECT = Effect(
    name="resistance_growth",
    title="Growing resistance (ageing within the record)",
    recognise="overvoltages of equal pulses grow from the beginning of a record to its end",
    source="Bloom et al., J. Power Sources 101, 2001",
    parameters=(Parameter("growth_per_Ah", "1/Ah", "relative growth of the resistance for each Ah, either way"),),
    shows_over=("throughput_Ah", "time_h"),
    slow=True,
    regressors=_regressors,
    overpotential=True,
    renews=LINEAR,
    lean=Lean(_columns, lambda _view: (0.0,), possible=lambda view: _MOST_A_CHARGE / view.capacity_Ah),
    expected=Expected(_expected),
    life="resistance",
)
