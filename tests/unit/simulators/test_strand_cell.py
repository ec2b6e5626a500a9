"""The truth of strands that share a cell's current, and its effects."""

from dataclasses import replace

import numpy as np
import pytest

from simulators.strand_cell import StrandCell, StrandParameters
from simulators.strand_cells import STRAND_EFFECTS, random_strand_cell


def drawn(seed: int = 2) -> StrandParameters:
    return random_strand_cell(np.random.default_rng(seed))


def test_the_curve_never_falls() -> None:
    for seed in range(10):
        p = drawn(seed)
        assert (np.diff(p.curve_V()) > -1e-12).all()
        assert p.curve_V()[1050] == pytest.approx(p.full_V, abs=1e-6)


def test_charge_is_counted() -> None:
    p = replace(drawn(), leakage_A=0.1)
    out = StrandCell(p, 0.4).step(p.capacity_Ah, 600.0)
    assert out.soc == pytest.approx(0.4 + (p.capacity_Ah - 0.1) / p.capacity_Ah / 6.0, abs=1e-9)


def test_unequal_strands_drift_apart_and_come_together_in_a_rest() -> None:
    p = replace(drawn(), play_V=0.0, strand_Ohm=(0.02 / 8.0, 0.1 / 8.0), share=(1.0, 1.0), capacity_Ah=8.0)
    cell = StrandCell(p, 0.9)
    cell.step(-p.capacity_Ah, 1200.0)
    left = []
    for seconds in (30.0, 600.0, 3600.0):
        out = cell.step(0.0, seconds)
        left.append(abs(out.open_circuit_V - out.voltage_V))
    # Alike strands have nothing to settle but their slow voltage, which is gone within minutes.
    same = StrandCell(replace(p, strand_Ohm=(0.06 / 8.0, 0.06 / 8.0), slow_s=10.0), 0.9)
    same.step(-p.capacity_Ah, 1200.0)
    rested = same.step(0.0, 600.0)
    assert left[0] > left[1] > left[2]
    assert abs(rested.open_circuit_V - rested.voltage_V) < 1e-5 < left[1]


def test_the_memory_is_above_on_charge_and_keeps_its_place_in_a_rest() -> None:
    p = replace(drawn(), leakage_A=0.0)
    cell = StrandCell(p, 0.5)
    distance_s = 3600.0 * 2.0 * p.play_wide
    up = cell.step(p.capacity_Ah, distance_s).hysteresis_V
    down = cell.step(-p.capacity_Ah, distance_s).hysteresis_V
    assert up == pytest.approx(0.5 * p.play_V, rel=0.1) and down == pytest.approx(-0.5 * p.play_V, rel=0.1)
    assert cell.step(0.0, 60.0).hysteresis_V == pytest.approx(down, abs=0.1 * p.play_V)


def test_cold_resists_more() -> None:
    p = replace(drawn(), play_V=0.0, entropy_V_per_K=(0.0, 0.0))
    lost = []
    for degC in (25.0, 5.0):
        out = StrandCell(p, 0.6, degC).step(-0.01 * p.capacity_Ah, 0.01)
        lost.append(out.open_circuit_V - out.voltage_V)
    assert lost[1] / lost[0] == pytest.approx(np.exp(2.0 * p.cold + 4.0 * p.cold_bend), rel=1e-2)


def test_the_heat_is_in_the_body_or_gone() -> None:
    p = replace(drawn(), cooling_W_per_K=0.0)
    out = StrandCell(p, 0.9).step(-2.0 * p.capacity_Ah, 300.0)
    assert out.heat_J > 0.0
    assert p.heat_J_per_K * (out.temperature_degC - 25.0) == pytest.approx(out.heat_J, rel=1e-9)


def test_long_steps_end_where_short_ones_do() -> None:
    p = drawn()
    long, short = StrandCell(p, 0.7), StrandCell(p, 0.7)
    for current in (-1.0, 0.5, 0.0):
        one = long.step(current * p.capacity_Ah, 300.0)
        many = [short.step(current * p.capacity_Ah, 1.0) for _ in range(300)][-1]
    assert one.voltage_V == pytest.approx(many.voltage_V, abs=5e-4)


@pytest.mark.parametrize("name", sorted(STRAND_EFFECTS))
def test_every_effect_shows_and_nothing_of_it_changes_nothing(name: str) -> None:
    p = drawn()
    same, more = (STRAND_EFFECTS[name](p, x) for x in (0.0, 0.5))
    assert same == p
    before, after = StrandCell(p, 0.2, 15.0), StrandCell(more, 0.2, 15.0)
    for current in (-0.3, 0.0, 1.0):
        was, now = (cell.step(current * p.capacity_Ah, 400.0) for cell in (before, after))
    assert abs(now.voltage_V - was.voltage_V) > 1e-4 or abs(now.temperature_degC - was.temperature_degC) > 0.05
