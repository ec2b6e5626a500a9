"""A cell as its training runs know it: voltage, covariance, error elsewhere, and the document of all that."""

import json
from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.diagnosis.known.elsewhere import OWN_LOAD, PLACES, TIMES, Points, level, points_of
from models.diagnosis.known.fitting import fit_known
from models.diagnosis.known.points import spread
from models.diagnosis.known.record import from_json, to_json
from models.effects.view import View
from models.identification.bounded.fitted import simulated
from models.identification.bounded.layout import soc_over
from models.identification.bounded.problem import regressors
from models.identification.bounded.variants import Variant
from models.network.regression import SignalBank
from tests.unit.models.diagnosis.known.hand_cell import SOC, known_runs, steps_A, trained, true_run
from tests.unit.models.hand_network import CAPACITY_AH
from tests.unit.models.identification.bounded.bank import bank, lead_V, two_electrodes


def view(largest_A: float = 3.0) -> View:
    run = true_run(steps_A(1200, 5, largest_A=largest_A))
    return View(known_runs().cell, run, SOC, np.arange(0, 1200, 7))


def test_the_voltage_is_that_of_the_cell() -> None:
    seen = view()
    np.testing.assert_allclose(seen.residual_V, 0.0, atol=6e-4)
    assert known_runs().cell.typical_Ohm == pytest.approx(0.02, rel=0.1)


def test_regressors_times_coefficients_are_the_voltage() -> None:
    seen, cell = view(), known_runs().cell
    rows = cell.regressors(seen.inputs, seen.soc[seen.index])
    np.testing.assert_allclose(rows @ cell.coefficients, seen.voltage_V, atol=1e-9)


def test_what_is_behind_a_surface_is_no_resistance_and_warms_as_charge_that_has_not_spread() -> None:
    two = two_electrodes(0.8)
    form = Variant((0.1, 268.0, 3500.0), behind=True)
    cell, _ = fit_known(two.runs, two.initial_soc, two.cell.capacity_Ah, form, starts_known=True)
    seen = View(cell, two.runs[0], two.initial_soc[0], np.arange(0, 6000, 7))
    assert np.sqrt(np.mean(seen.residual_V**2)) < 2e-3
    assert cell.typical_Ohm == pytest.approx(0.02, rel=0.15)
    # All that is lost is what the terminals have more than a cell whose charge has spread, loop and temperature apart.
    soc = seen.soc[seen.index]
    others = np.concatenate([cell.terms_of("hysteresis_state"), cell.terms_of("temperature")])
    kept_V = cell.through(seen.inputs.signals, soc + seen.inputs.surface, others)
    lost_V = cell.loss_V(seen.inputs, soc)
    np.testing.assert_allclose(lost_V + kept_V, seen.voltage_V - cell.open_circuit_V(soc), atol=1e-9)
    truly_V = 0.02 * two.runs[0].current_A[seen.index] + lead_V(two)[seen.index]
    assert np.sqrt(np.mean((lost_V - truly_V) ** 2)) < 0.1 * np.sqrt(np.mean(truly_V**2))


@pytest.mark.parametrize("form", [Variant((0.05, 300.0, 6500.0, 30.0)), Variant((0.1, 268.0, 3500.0), behind=True)])
def test_a_run_is_seen_as_the_fit_saw_it(form: Variant) -> None:
    moved = bank(n=3000, swing_K=8.0)
    # Down to a tenth of the charge, where a diffusion that slows down towards empty takes several times as long.
    drained = SignalBank(moved.runs, [0.2] * len(moved.runs), moved.cell)
    cell, _ = fit_known(drained.runs, drained.initial_soc, drained.cell.capacity_Ah, form, starts_known=True)
    rows = regressors(drained, cell.layout.basis, cell.layout.scale)
    fitted_V = simulated(cell.layout, cell.coefficients, rows, np.concatenate(soc_over(drained, form.axis)))
    seen = View(cell, drained.runs[0], drained.initial_soc[0], np.arange(1, 3000))
    np.testing.assert_allclose(seen.voltage_V, fitted_V[1:3000], atol=1e-9)
    # Of a cell with half of the capacity, say, a surface is twice as far ahead, and the mean as far behind it.
    ahead = seen.inputs.ahead(2.0)
    np.testing.assert_array_equal(ahead.surface, 2.0 * seen.inputs.surface)
    moved = np.flatnonzero((ahead.signals != seen.inputs.signals).any(axis=1))
    np.testing.assert_array_equal(moved, cell.terms_of("behind_surface"))


def test_overvoltage_is_linear_in_the_current() -> None:
    seen = view()
    one, two = seen.overvoltage(seen.run.current_A), seen.overvoltage(2.0 * seen.run.current_A)
    np.testing.assert_allclose(two, 2.0 * one, atol=1e-6)
    assert np.corrcoef(one, seen.run.current_A[seen.index])[0, 1] > 0.99


def test_what_was_not_trained_is_open() -> None:
    cell = known_runs().cell
    low, high = cell.soc_range
    rows = np.array(
        [np.interp(cell.layout.knots.soc, cell.layout.knots.soc, one) for one in np.eye(len(cell.layout.knots.soc))]
    )
    curve = cell.covariance[: len(rows), : len(rows)]
    std = np.sqrt(np.diag(curve))
    inside = (cell.layout.knots.soc > low) & (cell.layout.knots.soc < high)
    assert std[~inside].max() > 5.0 * std[inside].max()


def test_the_process_is_pinned_where_it_was_trained_and_grows_away_from_it() -> None:
    known = known_runs()
    near = points_of(View(known.cell, trained(1), SOC, np.arange(100, 200, 10)), 1000, known.cell.domain)
    far = replace(near, soc=near.soc + 0.3, away=near.away + 2.0)
    near_V2, far_V2 = (known.elsewhere.conditional(each)[1] for each in (near, far))
    assert np.diag(far_V2).mean() > 3.0 * np.diag(near_V2).mean()
    assert np.linalg.eigvalsh(near_V2 + 1e-9 * np.eye(len(near_V2))).min() > 0.0


def test_errors_are_as_large_as_near_by() -> None:
    known = known_runs()
    points = known.elsewhere.known
    error_V = np.where(points.soc > np.median(points.soc), 0.01, 0.001)
    found = level(points, points, error_V)
    assert (
        found[points.soc > np.quantile(points.soc, 0.8)].mean()
        > 3.0 * found[points.soc < np.quantile(points.soc, 0.2)].mean()
    )


def test_a_run_may_have_another_resistance_at_low_charge_than_the_ones_before() -> None:
    """Alike over an hour of it, and nothing like what another run has of its own."""
    known = known_runs()
    own = len(PLACES) + TIMES.index(OWN_LOAD)
    elsewhere = replace(known.elsewhere, variances=np.eye(len(known.elsewhere.variances))[own])
    seen = points_of(View(known.cell, trained(1), SOC, np.arange(100, 110)), 1000, known.cell.domain)
    later = replace(seen, time_s=seen.time_s + 3600.0)
    other = replace(seen, run=seen.run + 1.0)
    whole_V2 = elsewhere.in_time(Points.joined([seen, later, other]))
    n = len(seen.time_s)
    np.testing.assert_allclose(whole_V2[:n, n : 2 * n], whole_V2[:n, :n])
    assert not whole_V2[:n, 2 * n :].any() and whole_V2[:n, :n].any()
    np.testing.assert_allclose(elsewhere.own_load(other, other), whole_V2[2 * n :, 2 * n :])


def test_points_are_spread_over_all_samples() -> None:
    chosen = spread(1000, 10, 3)
    np.testing.assert_array_equal(chosen // 100, np.arange(10))
    np.testing.assert_array_equal(spread(4, 10, 3), np.arange(4))


def test_it_survives_as_json_and_a_damaged_one_is_refused() -> None:
    known = known_runs()
    document = json.loads(json.dumps(to_json(known), allow_nan=False))
    again = from_json(document)
    np.testing.assert_allclose(again.cell.covariance, known.cell.covariance, rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(again.elsewhere.known.rates, known.elsewhere.known.rates, rtol=1e-6, atol=1e-12)
    assert again.elsewhere.granted == known.elsewhere.granted
    for broken in ({"kind": "other"}, {"coefficients": [1.0]}, {"knots": None}, {"left_V": [3.0]}):
        with pytest.raises(ModelError, match="fit the model again"):
            from_json(document | broken)


def test_a_document_from_before_runs_had_a_load_of_their_own_is_read() -> None:
    known = known_runs()
    own = len(PLACES) + TIMES.index(OWN_LOAD)
    document = to_json(known) | {"schema_version": 2, "variances": np.delete(known.elsewhere.variances, own).tolist()}
    variances = from_json(document).elsewhere.variances
    assert variances[own] == 0.0
    np.testing.assert_allclose(np.delete(variances, own), np.delete(known.elsewhere.variances, own))
    with pytest.raises(ModelError, match="sizes do not fit"):
        from_json(document | {"schema_version": 3})


def test_capacity_is_that_of_the_cell() -> None:
    assert known_runs().cell.capacity_Ah == CAPACITY_AH
