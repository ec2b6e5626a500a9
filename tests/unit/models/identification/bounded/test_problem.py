"""Sums of products, held against the dense matrix that they are the sums of."""

from dataclasses import replace

import numpy as np
import pytest

from models.identification.bounded.knots import hats, make_knots
from models.identification.bounded.layout import REFERENCE_DEGC, Layout, make_layout, slope_limit, soc_over
from models.identification.bounded.problem import fold_of, make_sums, penalty_forms, regressors, rest_weights
from models.identification.bounded.strengths import START, HeldOut
from models.identification.bounded.terms import make_basis
from models.network.regression import SignalBank
from tests.unit.models.identification.bounded.bank import CELL, bank


@pytest.fixture(scope="module")
def signals() -> SignalBank:
    return bank(n=1500, swing_K=5.0)


@pytest.fixture(scope="module")
def layout(signals: SignalBank) -> Layout:
    soc = np.concatenate(soc_over(signals, "soc"))
    basis = make_basis(1.0, CELL.capacity_Ah, "moves")
    return make_layout(signals, basis, make_knots(float(soc.min()), float(soc.max()), 24, 5, 4))


def dense(signals: SignalBank, layout: Layout) -> np.ndarray:
    """(N, P) one row a sample, the curve by its values."""
    soc = np.concatenate(soc_over(signals, layout.basis.axis))
    rows = regressors(signals, layout.basis, layout.scale)
    parts = [hats(layout.knots.soc, soc)]
    parts += [rows[:, [b]] * hats(layout.knots.soc[layout.places(b)], soc) for b in range(len(layout.basis.terms))]
    return np.hstack(parts)


def test_sums_of_each_fold_are_those_of_the_dense_matrix(signals: SignalBank, layout: Layout) -> None:
    a, y = dense(signals, layout), np.concatenate([run.voltage_V for run in signals.runs])
    fold, sums = fold_of(signals), make_sums(signals, layout)
    assert set(fold) == set(range(len(sums.count)))
    for number in range(len(sums.count)):
        own = fold == number
        np.testing.assert_allclose(sums.xx[number], a[own].T @ a[own], atol=1e-8)
        np.testing.assert_allclose(sums.xy[number], a[own].T @ y[own], atol=1e-8)
        assert (sums.yy[number], sums.count[number]) == (pytest.approx(y[own] @ y[own]), own.sum())


def test_every_n_th_sample_and_folds_of_ones_own(signals: SignalBank, layout: Layout) -> None:
    a, fold = dense(signals, layout), np.arange(3000) % 2
    sums = make_sums(signals, layout, 3, fold)
    chosen = np.arange(0, 3000, 3)
    np.testing.assert_allclose(sums.xx.sum(axis=0), a[chosen].T @ a[chosen], atol=1e-8)
    assert sums.count.tolist() == [500.0, 500.0]


def test_samples_that_weigh_more_are_as_if_they_came_more_often(signals: SignalBank, layout: Layout) -> None:
    a, y = dense(signals, layout), np.concatenate([run.voltage_V for run in signals.runs])
    often = np.random.default_rng(3).integers(1, 4, len(y))
    sums = make_sums(signals, layout, weight=often.astype(np.float64))
    each = np.repeat(np.arange(len(y)), often)
    np.testing.assert_allclose(sums.xx.sum(axis=0), a[each].T @ a[each], atol=1e-8)
    np.testing.assert_allclose(sums.xy.sum(axis=0), a[each].T @ y[each], atol=1e-8)
    assert sums.yy.sum() == pytest.approx(y[each] @ y[each])
    assert sums.count.sum() == len(each)


def test_a_rest_weighs_the_less_the_longer_it_lasts(signals: SignalBank) -> None:
    run = signals.runs[0]
    current = np.full(len(run), 1.0)
    current[:100], current[400:1000] = 0.0, 1e-3 * signals.cell.rest_A
    weight = rest_weights(SignalBank([replace(run, current_A=current)], [0.6], signals.cell))
    assert weight.shape == (len(run),) and weight.max() == 1.0
    assert (weight[100:400] == 1.0).all() and (weight[1000:] == 1.0).all()
    np.testing.assert_allclose(weight[400:1000], 1.0 / (1.0 + np.arange(1, 601) / 60.0))
    # A record that begins at rest: how long that has lasted before is not known.
    np.testing.assert_allclose(weight[:100], weight[400:500])
    # A logger that takes a sample a minute in a rest has thinned it.
    measured = np.ones(len(run), dtype=bool)
    measured[400:1000] = np.arange(1, 601) % 60 == 0
    thinned = rest_weights(SignalBank([replace(run, current_A=current, measured=measured)], [0.6], signals.cell))
    np.testing.assert_allclose(thinned[459:1000:60], 1.0)


def test_increments_are_the_same_curve(signals: SignalBank, layout: Layout) -> None:
    sums = make_sums(signals, layout)
    turned, n = sums.by_increments(), layout.n_curve
    x = np.random.default_rng(0).standard_normal(layout.size)
    by_values = np.concatenate([np.cumsum(x[:n]), x[n:]])
    for own, whole in ((turned.xx[0], sums.xx[0]), (turned.penalties[0], sums.penalties[0])):
        assert x @ own @ x == pytest.approx(by_values @ whole @ by_values)
    assert x @ turned.xy[1] == pytest.approx(by_values @ sums.xy[1])


def test_a_change_with_temperature_costs_what_it_does_over_some_tenths_of_a_kelvin(layout: Layout) -> None:
    form = penalty_forms(layout, np.ones(len(layout.basis.terms)))[4]
    (at,) = [b for b, term in enumerate(layout.basis.terms) if term.signal == "temperature"]
    x = np.zeros(layout.size)
    x[layout.first[at] : layout.first[at + 1]] = 2e-3 * layout.scale[at]
    assert x @ form @ x == pytest.approx((2e-3 * 0.3) ** 2)
    x[:] = 1.0
    x[layout.first[at] : layout.first[at + 1]] = 0.0
    assert x @ form @ x == 0.0


def test_what_a_temperature_that_hardly_moves_seems_to_say_is_not_believed() -> None:
    # A voltage that drifts with the temperature, once by a tenth of a kelvin and once by ten.
    found = []
    for swing_K in (0.1, 10.0):
        signals = bank(n=1500, swing_K=swing_K)
        drift_V = [1e-3 * (run.temperature_degC - REFERENCE_DEGC) for run in signals.runs]
        runs = [replace(run, voltage_V=run.voltage_V + more) for run, more in zip(signals.runs, drift_V, strict=True)]
        drifting = SignalBank(runs, signals.initial_soc, signals.cell)
        soc = np.concatenate(soc_over(drifting, "soc"))
        knots = make_knots(float(soc.min()), float(soc.max()), 24, 5, 4)
        layout = make_layout(drifting, make_basis(1.0, CELL.capacity_Ah, "moves"), knots)
        x = HeldOut(make_sums(drifting, layout).by_increments()).whole(START).x
        found.append(float(np.mean(x[layout.first[-2] :] / layout.scale[-1])))
    assert abs(found[0]) < 2e-4
    assert found[1] == pytest.approx(1e-3, abs=2e-4)


def test_gains_are_not_negative_and_the_slope_with_temperature_is_one_that_cells_have(layout: Layout) -> None:
    box = layout.box
    (at,) = [b for b, term in enumerate(layout.basis.terms) if term.signal == "temperature"]
    slope = np.arange(layout.first[at], layout.first[at + 1])
    assert np.flatnonzero(box.lower != 0.0).tolist() == [0, *slope]
    assert np.flatnonzero(np.isfinite(box.upper)).tolist() == slope.tolist()
    np.testing.assert_allclose(box.upper[slope] / layout.scale[at], layout.slope_limit_V_per_K)
    np.testing.assert_array_equal(box.lower[slope], -box.upper[slope])


def test_a_curve_may_change_more_with_temperature_where_it_is_steep() -> None:
    knots = make_knots(0.0, 1.0, 48, 9, 6)
    curve_V = 3.6 + 0.4 * knots.soc - 0.6 * np.exp(-knots.soc / 0.03)
    limit = slope_limit(knots, curve_V)
    assert 8e-4 * 3.8 < limit[2:].max() < 5e-3 and 6e-3 < limit[0] < 2e-2
    np.testing.assert_allclose(slope_limit(knots, 0.3 * curve_V), 0.3 * limit)  # a module, or another chemistry


def test_signals_are_counted_from_what_their_gain_is_zero_at(signals: SignalBank, layout: Layout) -> None:
    rows = regressors(signals, layout.basis, layout.scale)
    largest = dict(zip((term.signal for term in layout.basis.terms), np.abs(rows).max(axis=0), strict=True))
    # What flows one way only is measured by the larger of both ways.
    either_way = [max(largest[term.signal], largest[term.mirrored]) for term in layout.basis.terms]
    np.testing.assert_allclose(either_way, 1.0)
    degC = np.concatenate([run.temperature_degC for run in signals.runs])
    np.testing.assert_allclose(rows[:, -1] * layout.scale[-1], degC - REFERENCE_DEGC)
