"""The open-circuit curve rises at every trained temperature and on either branch of the loop."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.timeseries import FloatArray
from models.identification.bounded.knots import hats, make_knots
from models.identification.bounded.layout import REFERENCE_DEGC, Layout, make_layout
from models.identification.bounded.monotone import corner_increments, rising
from models.identification.bounded.problem import make_sums
from models.identification.bounded.strengths import HeldOut
from models.identification.bounded.terms import Basis, Term
from models.network.regression import SignalBank
from tests.unit.models.identification.bounded.bank import bank

WEAK = (-6.0, -6.0, -6.0, -6.0)
LOOP = "hysteresis_state:40"
BASIS = Basis("soc", (Term("current"), Term(LOOP, ("hysteresis",)), Term("temperature", bounded=False)))


def tilted(slope_V_per_K: float, loop_V: float) -> tuple[HeldOut, SignalBank]:
    """A flat curve whose slope with temperature and whose loop's width change along it: somewhere it falls."""
    known = bank(n=3000, swing_K=8.0)
    runs = []
    for k, run in enumerate(known.runs):
        soc, loop = known.values("soc")[k], known.values(LOOP)[k]
        away = run.temperature_degC - REFERENCE_DEGC
        wave = np.sin(12.0 * soc)
        voltage = 3.3 + 0.02 * soc + 0.02 * run.current_A + slope_V_per_K * wave * away + loop_V * (1.0 + wave) * loop
        runs.append(replace(run, voltage_V=voltage))
    signals = SignalBank(runs, known.initial_soc, known.cell)
    soc = np.concatenate(signals.values("soc"))
    layout = make_layout(signals, BASIS, make_knots(float(soc.min()), float(soc.max()), 48, 9, 24))
    return HeldOut(make_sums(signals, layout).by_increments()), signals


def curve_V(layout: Layout, x: FloatArray, degC: float, side: float) -> FloatArray:
    """(n,) open-circuit voltage at the knots."""
    knots = layout.knots.soc
    parts = [x[layout.first[b] : layout.first[b + 1]] for b in range(len(layout.basis.terms))]
    gains = [hats(knots[layout.places(b)], knots) @ part for b, part in enumerate(parts)]
    own = np.cumsum(x[: layout.n_curve])
    return own + gains[1] * side / layout.scale[1] + gains[2] * (degC - REFERENCE_DEGC) / layout.scale[2]


@pytest.mark.parametrize(("slope_V_per_K", "loop_V"), [(0.0, 0.03), (2e-3, 0.0), (2e-3, 0.03)])
def test_it_rises_where_without_care_it_would_fall(slope_V_per_K: float, loop_V: float) -> None:
    held, signals = tilted(slope_V_per_K, loop_V)
    layout = held.sums.layout
    degC = np.concatenate([run.temperature_degC for run in signals.runs])
    low, high = float(degC.min()), float(degC.max())
    corners = [(at, side) for at in (low, REFERENCE_DEGC, high) for side in (-1.0, 1.0)]
    plain = held.whole(WEAK).x
    assert min(np.diff(curve_V(layout, plain, *corner)).min() for corner in corners) < -1e-3
    risen = rising(held, WEAK, (low, high))
    assert min(np.diff(curve_V(layout, risen, *corner)).min() for corner in corners) > -1e-9
    assert (risen >= layout.box.lower).all()


def test_a_curve_that_rises_by_itself_stays_as_it_is() -> None:
    held, _ = tilted(0.0, 0.0)
    np.testing.assert_array_equal(rising(held, WEAK, (20.0, 30.0)), held.whole(WEAK).x)


def test_corners_are_both_branches_at_the_three_temperatures() -> None:
    held, _ = tilted(1e-3, 0.02)
    layout = held.sums.layout
    rises = corner_increments(layout, (15.0, 40.0))
    x = np.random.default_rng(2).standard_normal(layout.size)
    found = {tuple(np.round(part, 9)) for part in (rises @ x).reshape(-1, layout.n_curve - 1)}
    wanted = {
        tuple(np.round(np.diff(curve_V(layout, x, degC, side)), 9))
        for degC in (15.0, REFERENCE_DEGC, 40.0)
        for side in (-1.0, 1.0)
    }
    assert len(found) == 6 and np.allclose(sorted(found), sorted(wanted), atol=1e-8)
