"""What may stand in a run's beginning: each state fades as it would in the cell."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.known.start import start_columns
from models.diagnosis.known.thresholds import KNOWN
from models.effects.view import View
from models.network.signals import parse_signal
from tests.unit.models.diagnosis.known.hand_cell import SOC, known_runs, steps_A, true_run

SOC_STD = 0.01
INDEX = np.arange(0, 1200, 7)


def seen(current_A: np.ndarray | None = None) -> View:
    run = true_run(steps_A(1200, 5) if current_A is None else current_A)
    return View(known_runs().cell, run, SOC, INDEX)


def test_a_state_of_charge_off_by_a_deviation_moves_the_voltage_along_the_curve() -> None:
    columns = start_columns(known_runs().cell, seen(), SOC_STD)
    # The hand-made curve rises by 0.7 V: a tenth of the fit's own error in its slope.
    np.testing.assert_allclose(columns[:, 0], 0.7 * SOC_STD, rtol=0.3)
    assert np.abs(columns[:, 1]).max() < 0.1 * np.abs(columns[:, 0]).max()


def test_the_place_in_a_loop_is_forgotten_with_the_charge_and_not_with_time() -> None:
    still, moved = (start_columns(known_runs().cell, seen(each), SOC_STD)[:, 2] for each in (np.zeros(1200), None))
    np.testing.assert_allclose(still, KNOWN.start_V)
    assert moved[0] == pytest.approx(KNOWN.start_V, rel=0.02) and moved[-1] < 0.9 * KNOWN.start_V
    assert np.all(np.diff(moved) <= 1e-15)


def test_what_no_branch_stands_for_fades_with_its_time_constants() -> None:
    cell, view = known_runs().cell, seen()
    depth = bool(parse_signal(cell.layout.basis.axis).get("depth"))
    columns = start_columns(cell, view, SOC_STD)
    last = columns.shape[1] - int(depth)
    size_V = KNOWN.start_of_typical * cell.typical_Ohm * KNOWN.start_share * cell.usual_A
    for column, tau_s in zip(columns[:, last - len(KNOWN.start_s) : last].T, KNOWN.start_s, strict=True):
        np.testing.assert_allclose(column, size_V * np.exp(-INDEX * cell.dt_s / tau_s))


def test_a_branch_of_the_cell_may_begin_charged_as_it_usually_is() -> None:
    cell, view = known_runs().cell, seen(np.zeros(1200))
    columns = start_columns(cell, view, SOC_STD)
    kinds = [parse_signal(term.signal) for term in cell.layout.basis.terms]
    open_ = [each for each in kinds if each.kind == "hysteresis_state" or each.get("time_constant_s")]
    assert columns.shape[1] == 3 + len(open_) + len(KNOWN.start_s)
    for number, signal in enumerate(open_):
        column = columns[:, 3 + number]
        tau_s = signal.get("time_constant_s")
        # At rest the state of charge stays, so that nothing but the state's own fading is seen.
        faded = np.exp(-INDEX * cell.dt_s / tau_s) if tau_s else np.ones(len(INDEX))
        np.testing.assert_allclose(column, column[0] * faded, atol=1e-12)


def test_time_counts_from_the_log_and_not_from_what_flowed_before() -> None:
    cell, view = known_runs().cell, seen()
    later = replace(view.run, time_s=view.run.time_s + 5000.0)
    np.testing.assert_array_equal(
        start_columns(cell, replace(view, run=later), SOC_STD), start_columns(cell, view, SOC_STD)
    )
