"""The two-particle truth against closed forms, and its effects."""

import math
from dataclasses import replace

import numpy as np
import pytest

from simulators.particle_cell import ParticleCell, ParticleParameters
from simulators.particle_cells import PARTICLE_EFFECTS, random_particle_cell

F_OVER_RT = 11604.518 / 298.15


def drawn(seed: int = 1) -> ParticleParameters:
    return random_particle_cell(np.random.default_rng(seed))


def quiet(p: ParticleParameters) -> ParticleParameters:
    """One whose temperature and electrolyte stand still, without lag and film."""
    return replace(p, heat_J_per_K=1e12, electrolyte_V=0.0, lag_V=0.0, film_Ohm=0.0)


def test_at_rest_it_shows_its_open_circuit_voltage() -> None:
    for seed in range(5):
        curve = [ParticleCell(drawn(seed), soc).step(0.0, 0.0) for soc in np.linspace(0.02, 0.98, 40)]
        assert all(each.voltage_V == pytest.approx(each.open_circuit_V, abs=1e-9) for each in curve)
        assert all(b.voltage_V > a.voltage_V for a, b in zip(curve, curve[1:], strict=False))


def test_charge_is_counted_and_leaks() -> None:
    p = replace(drawn(), leakage_A=0.02)
    cell = ParticleCell(p, 0.4)
    out = [cell.step(p.capacity_Ah, 5.0) for _ in range(120)][-1]
    assert out.soc == pytest.approx(0.4 + (p.capacity_Ah - 0.02) / p.capacity_Ah * 600.0 / 3600.0, abs=1e-9)


def test_the_surface_runs_ahead_by_a_fifteenth_of_the_diffusion_time() -> None:
    """Steady gradient in a sphere: rate R^2 / (15 D) (Crank 1975, eq. 6.45 for long times)."""
    p = quiet(drawn())
    electrode = replace(p.negative, diffusion_s=300.0, crowding=0.0, exchange_A=1e9, curve=(), slope_V=0.5)
    p = replace(p, negative=electrode, positive=replace(p.positive, diffusion_s=1e-3, exchange_A=1e9))
    current = -0.5 * p.capacity_Ah
    cell = ParticleCell(p, 0.7)
    out = [cell.step(current, 5.0) for _ in range(240)][-1]
    lead = -0.5 / 3600.0 * (electrode.at_full - electrode.at_empty) * 300.0 / 15.0
    mean = electrode.at_empty + out.soc * (electrode.at_full - electrode.at_empty)
    expected = electrode.potential_V(mean) - electrode.potential_V(mean + lead)
    assert out.voltage_V - out.open_circuit_V == pytest.approx(expected, rel=0.01)


def test_equal_transfer_coefficients_are_an_inverse_hyperbolic_sine() -> None:
    p = quiet(drawn())
    fast = replace(p.negative, exchange_A=1e9, diffusion_s=1e-3)
    p = replace(p, negative=fast, positive=replace(p.positive, transfer=0.5, diffusion_s=1e-3, exchange_A=2.0))
    out = ParticleCell(p, 0.5).step(-6.0, 0.001)
    filling = p.positive.at_empty + 0.5 * (p.positive.at_full - p.positive.at_empty)
    exchange_A = 2.0 * 2.0 * math.sqrt(filling * (1.0 - filling))
    expected = 2.0 / F_OVER_RT * math.asinh(-6.0 / (2.0 * exchange_A))
    assert out.voltage_V - out.open_circuit_V == pytest.approx(expected, abs=1e-5)


def test_heat_is_what_the_voltage_loses() -> None:
    p = replace(drawn(), cooling_W_per_K=1e-9, entropy_V_per_K=0.0)
    still = {"entropy_V_per_K": (0.0, 0.0)}
    p = replace(p, negative=replace(p.negative, **still), positive=replace(p.positive, **still))
    cell, lost_J = ParticleCell(p, 0.6), 0.0
    for _ in range(200):
        out = cell.step(-p.capacity_Ah, 1.0)
        lost_J += -p.capacity_Ah * (out.voltage_V - out.open_circuit_V)
    assert out.heat_J == pytest.approx(lost_J, rel=1e-9)
    assert out.temperature_degC - 25.0 == pytest.approx(lost_J / p.heat_J_per_K, rel=1e-4)


def test_long_steps_end_where_short_ones_do() -> None:
    p = drawn()
    long, short = ParticleCell(p, 0.7), ParticleCell(p, 0.7)
    for current in (-1.0, 0.5, 0.0):
        one = long.step(current * p.capacity_Ah, 300.0)
        many = [short.step(current * p.capacity_Ah, 1.0) for _ in range(300)][-1]
    assert one.voltage_V == pytest.approx(many.voltage_V, abs=3e-4)
    assert one.temperature_degC == pytest.approx(many.temperature_degC, abs=0.05)


def test_the_lag_follows_the_direction_of_charge() -> None:
    p = replace(drawn(), lag_rate=50.0)
    cell = ParticleCell(p, 0.5)
    down = [cell.step(-p.capacity_Ah, 5.0) for _ in range(120)][-1]
    up = [cell.step(p.capacity_Ah, 5.0) for _ in range(120)][-1]
    assert down.hysteresis_V < -0.8 * p.lag_V and up.hysteresis_V > 0.8 * p.lag_V


@pytest.mark.parametrize("name", sorted(PARTICLE_EFFECTS))
def test_every_effect_shows_and_nothing_of_it_changes_nothing(name: str) -> None:
    p = drawn()
    same, more = (PARTICLE_EFFECTS[name](p, x) for x in (0.0, 0.5))
    assert same == p
    before, after = ParticleCell(p, 0.3, 15.0), ParticleCell(more, 0.3, 15.0)
    for current in (-1.0, 0.0, 1.0):
        was, now = (cell.step(current * p.capacity_Ah, 400.0) for cell in (before, after))
    assert abs(now.voltage_V - was.voltage_V) > 1e-4 or abs(now.temperature_degC - was.temperature_degC) > 0.05
