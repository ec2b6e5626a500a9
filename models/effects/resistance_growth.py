"""Resistance that grows with charge throughput."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import LINEAR, Effect, Lean, Parameter
from models.effects.expected import Expected, Form, Told
from models.effects.reading import Values
from models.effects.spline import SplineBasis
from models.effects.view import View

# A usual growth over so many full charges; and what a cell may lose with a single one: more is no ageing, but a
# resistance over the state of charge, which falls as charge is moved.
_USUAL_GROWTH, _USUAL_THROUGHPUT = 0.3, 5.0
_MOST_A_CHARGE = 0.3
# Resistances over the state of charge as fine as a cell may have them, in either direction of the current, must leave
# this share of the squared current times throughput. Drive cycles of one discharge leave 0.0002 and less (Panasonic,
# pybatteryid, A123), logs that come back to a state of charge 0.02 to 0.25 (Leaf, pybamm, own cells).
_BUMPS, _LEAST_SHARE, _LEAST_SPAN = 8, 0.003, 1e-3


def _grown_A(view: View, exponent: float = 1.0) -> FloatArray:
    """(n,) current times the charge that has passed; of another exponent a charge that is the same at the usual one."""
    if exponent == 1.0:
        return view.drive_A * view.aged_Ah
    usual_Ah = _USUAL_THROUGHPUT * view.capacity_Ah
    return view.drive_A * usual_Ah * (np.maximum(view.aged_Ah, 0.0) / usual_Ah) ** exponent


def _regressors(view: View) -> FloatArray:
    grown_A = _grown_A(view)
    return np.column_stack([view.overvoltage(grown_A), grown_A[view.index]])


def _columns(view: View, _shape: float) -> FloatArray:
    return view.overvoltage(_grown_A(view))[:, None]


def _expected(view: View) -> tuple[Form, ...]:
    """In proportion to the charge that has passed, or to its root, as a film grows that lets ever less through.

    Charge that passes makes no film thinner.
    """
    usual = _USUAL_GROWTH / (_USUAL_THROUGHPUT * view.capacity_Ah)
    told = (Told("growth_per_Ah", "1/Ah", (usual,)),)
    return tuple(
        Form(
            usual * view.overvoltage(_grown_A(view, exponent))[:, None], told, (("exponent", "1", exponent),), least=0.0
        )
        for exponent in (1.0, 0.5)
    )


def _seen_in(views: Sequence[View]) -> bool:
    """Whether the runs come back to a state of charge after other charge has passed.

    In one discharge the throughput is what the state of charge has fallen by: growth cannot be told from a resistance
    over the state of charge there, be it the cell's or the model's error. Each run is looked at by itself, because
    nobody says what has passed between two.
    """
    left, total = 0.0, 0.0
    for view in views:
        current_A, soc = view.run.current_A[view.index], view.soc[view.index]
        grown = current_A * view.throughput_Ah[view.index]
        whole = float(grown @ grown)
        if whole > 0.0:
            low = float(soc.min())
            bumps = SplineBasis(low, max(float(soc.max()), low + _LEAST_SPAN), _BUMPS).matrix(soc)
            each_way = [bumps * np.clip(current_A, *limits)[:, None] for limits in ((0.0, np.inf), (-np.inf, 0.0))]
            over_soc = np.hstack(each_way)
            rest = grown - over_soc @ np.linalg.lstsq(over_soc, grown, rcond=None)[0]
            left, total = left + float(rest @ rest), total + whole
    return left > _LEAST_SHARE * total


def _grown_V(view: View, values: Values) -> FloatArray:
    return values["growth_per_Ah"] * view.overvoltage(_grown_A(view, values.get("exponent", 1.0)))


EFFECT = Effect(
    name="resistance_growth",
    title="Growing resistance (ageing within the record)",
    recognise="overvoltages of equal pulses grow from the beginning of a record to its end",
    source="Bloom et al., J. Power Sources 101, 2001; of films: Ploehn et al., J. Electrochem. Soc. 151, 2004",
    parameters=(
        Parameter("growth_per_Ah", "1/Ah", "relative growth for each Ah, either way, over 5 capacities"),
        Parameter("exponent", "1", "of the charge that the growth goes with: 1, or 0.5 where it slows down"),
    ),
    shows_over=("throughput_Ah", "time_h"),
    slow=True,
    regressors=_regressors,
    overpotential=True,
    seen_in=_seen_in,
    renews=LINEAR,
    fault_V=_grown_V,
    lean=Lean(_columns, lambda _view: (0.0,), possible=lambda view: _MOST_A_CHARGE / view.capacity_Ah),
    expected=Expected(_expected),
    life="resistance",
)
