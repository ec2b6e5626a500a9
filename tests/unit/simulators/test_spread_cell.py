"""The truth of a spread of relaxation times and relays, and its effects."""

from dataclasses import replace

import numpy as np
import pytest

from simulators.spread_cell import SpreadCell, SpreadParameters
from simulators.spread_cells import SPREAD_EFFECTS, random_spread_cell


def drawn(seed: int = 2) -> SpreadParameters:
    return random_spread_cell(np.random.default_rng(seed))


def moved_to(cell: SpreadCell, soc: float) -> float:
    """Bring a cell to a state of charge and return what the loop adds there."""
    p = cell.parameters
    while abs(soc - cell.step(0.0, 0.0).soc) > 1e-4:
        gap = soc - cell.step(0.0, 0.0).soc
        cell.step(float(np.sign(gap)) * p.capacity_Ah, min(5.0, 3600.0 * abs(gap)))
    return cell.step(0.0, 0.0).hysteresis_V


def test_the_curve_never_falls() -> None:
    for seed in range(10):
        assert (np.diff(drawn(seed).curve_V()) > -1e-12).all()


def test_charge_is_counted() -> None:
    p = replace(drawn(), leakage_A=0.1)
    out = SpreadCell(p, 0.4).step(p.capacity_Ah, 600.0)
    assert out.soc == pytest.approx(0.4 + (p.capacity_Ah - 0.1) / p.capacity_Ah / 6.0, abs=1e-9)


def test_the_loop_is_above_on_charge_and_inner_loops_close() -> None:
    cell = SpreadCell(drawn(), 0.5)
    down = moved_to(cell, 0.35)
    up = moved_to(cell, 0.55)
    assert down < -0.2 * cell.parameters.loop_V < 0.2 * cell.parameters.loop_V < up
    # There and back again: the relays that had switched before are where they were.
    moved_to(cell, 0.53)
    assert moved_to(cell, 0.55) == pytest.approx(up, abs=0.03 * cell.parameters.loop_V)
    # A reversal that is too small for all relays leaves the loop inside.
    assert down < moved_to(cell, 0.545) < up


def test_the_step_response_spreads_over_decades() -> None:
    p = replace(drawn(), loop_V=0.0, entropy_V_per_K=(0.0, 0.0), core_J_per_K=1e12, case_J_per_K=1e12)
    cell = SpreadCell(p, 0.7)
    for _ in range(200):
        cell.step(-p.capacity_Ah, 5.0)
    left = []
    for seconds in (0.001, 10.0, 100.0, 1000.0):
        out = cell.step(0.0, seconds)
        left.append(out.open_circuit_V - out.voltage_V)
    assert all(b < 0.97 * a for a, b in zip(left, left[1:], strict=False)) and left[-1] > 0.05 * left[0]


def test_cold_resists_more_by_vogels_law() -> None:
    p = replace(drawn(), loop_V=0.0, entropy_V_per_K=(0.0, 0.0))
    lost = []
    for degC in (25.0, 5.0):
        out = SpreadCell(p, 0.6, degC).step(-0.1 * p.capacity_Ah, 0.01)
        lost.append(out.open_circuit_V - out.voltage_V)
    factor = np.exp(p.brittle_K * (1.0 / (5.0 - p.freezing_degC) - 1.0 / (25.0 - p.freezing_degC)))
    assert lost[1] / lost[0] == pytest.approx(factor, rel=1e-3)


def test_large_currents_meet_less_resistance() -> None:
    p = replace(drawn(), loop_V=0.0, knee_A=0.5)
    ohms = []
    for current in (0.01, 20.0):
        out = SpreadCell(p, 0.6).step(current, 1e-4)
        ohms.append((out.voltage_V - out.open_circuit_V) / current)
    assert ohms[1] < 0.6 * ohms[0]


def test_the_core_is_warmer_than_the_case_that_is_seen() -> None:
    p = drawn()
    out = SpreadCell(p, 0.9).step(-2.0 * p.capacity_Ah, 600.0)
    held_J = p.case_J_per_K * (out.temperature_degC - 25.0)
    assert 25.0 < out.temperature_degC
    assert held_J + p.core_J_per_K * (out.temperature_degC - 25.0) < out.heat_J


def test_long_steps_end_where_short_ones_do() -> None:
    p = drawn()
    long, short = SpreadCell(p, 0.7), SpreadCell(p, 0.7)
    for current in (-1.0, 0.5, 0.0):
        one = long.step(current * p.capacity_Ah, 300.0)
        many = [short.step(current * p.capacity_Ah, 1.0) for _ in range(300)][-1]
    assert one.voltage_V == pytest.approx(many.voltage_V, abs=5e-4)


@pytest.mark.parametrize("name", sorted(SPREAD_EFFECTS))
def test_every_effect_shows_and_nothing_of_it_changes_nothing(name: str) -> None:
    p = drawn()
    same, more = (SPREAD_EFFECTS[name](p, x) for x in (0.0, 0.5))
    assert same == p
    before, after = SpreadCell(p, 0.2, 15.0), SpreadCell(more, 0.2, 15.0)
    for current in (-0.3, 0.0, 1.0):
        was, now = (cell.step(current * p.capacity_Ah, 400.0) for cell in (before, after))
    assert abs(now.voltage_V - was.voltage_V) > 1e-4 or abs(now.temperature_degC - was.temperature_degC) > 0.05
