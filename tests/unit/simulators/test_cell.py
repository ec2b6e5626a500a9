"""Truth physics against closed forms and balances."""

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.catalogue import CELLS, cell_type
from simulators.cell import REFERENCE_K, Branch, Cell, CellParameters, advance, initial_state, observe
from simulators.chemistry import OpenCircuitCurve, Step

NAMES = sorted(CELLS)


def plain(name: str = "nmc", **changes: object) -> CellParameters:
    """Return a cell whose resistances move with nothing, so that every step has a closed form."""
    parameters = replace(
        CELLS[name].parameters, activation_K=0.0, ohmic_at_empty_Ohm=0.0, dU_dT_V_per_K=0.0, charge_transfer_V=0.0
    )
    return replace(parameters, **changes)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("name", NAMES)
def test_open_circuit_voltage_rises_everywhere(name: str) -> None:
    curve = CELLS[name].parameters.open_circuit
    socs = [i / 1000 for i in range(-50, 1051)]
    voltages = [curve.voltage_V(s) for s in socs]
    assert all(b > a for a, b in zip(voltages, voltages[1:], strict=False))
    for s in (0.013, 0.234, 0.5, 0.684, 0.97):
        numeric = (curve.voltage_V(s + 1e-6) - curve.voltage_V(s - 1e-6)) / 2e-6
        assert curve.slope_at_V(s) == pytest.approx(numeric, rel=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_open_circuit_voltage_spans_the_cells_limits(name: str) -> None:
    cell = CELLS[name]
    low, high = cell.limits.voltage_V
    curve = cell.parameters.open_circuit
    assert low < curve.voltage_V(0.0) < curve.voltage_V(1.0) < high
    assert high - curve.voltage_V(1.0) < 0.25


def test_lfp_plateaus_rise_by_about_a_tenth_of_a_volt() -> None:
    curve = CELLS["lfp"].parameters.open_circuit
    assert all(0.08 < curve.slope_at_V(s) < 0.13 for s in (0.45, 0.5, 0.55, 0.6, 0.8, 0.85, 0.9))


def test_a_falling_term_is_refused() -> None:
    with pytest.raises(ValueError, match="must be positive"):
        OpenCircuitCurve(3.0, 0.1, (Step(-0.1, 0.5, 0.1),), (), ())


def test_step_matches_the_closed_form() -> None:
    p = plain(hysteresis_amplitude_V=0.0)
    cell = Cell(p, soc=0.5)
    rested = cell.step(0.0, 0.0).voltage_V
    out = cell.step(2.0, 10.0)
    expected = 2.0 * p.ohmic_Ohm + sum(
        2.0 * b.resistance_Ohm * (1 - math.exp(-10.0 / b.time_constant_s)) for b in (p.fast_1, p.fast_2, p.slow)
    )
    soc = 0.5 + 2.0 * 10.0 / 3600 / p.capacity_Ah
    assert out.soc == pytest.approx(soc, abs=1e-15)
    assert out.voltage_V == pytest.approx(p.open_circuit.voltage_V(soc) + expected, abs=1e-12)
    assert rested == pytest.approx(p.open_circuit.voltage_V(0.5), abs=1e-12)


@settings(max_examples=40, deadline=None)
@given(
    name=st.sampled_from(NAMES),
    current_A=st.floats(-5, 5),
    parts=st.lists(st.floats(0.01, 40), min_size=2, max_size=6),
)
def test_constant_current_is_independent_of_the_split(name: str, current_A: float, parts: list[float]) -> None:
    p = plain(name)
    start = initial_state(0.5, 20.0)
    whole = advance(p, start, current_A, 25.0, sum(parts))
    state = start
    for part in parts:
        state = advance(p, state, current_A, 25.0, part)
    # The heat of a sub-step is spread evenly over it, so the temperature alone depends on the sub-steps, and little.
    assert state.overpotentials_V == pytest.approx(whole.overpotentials_V, abs=1e-13)
    assert state.hysteresis == pytest.approx(whole.hysteresis, abs=1e-13)
    assert state.soc == pytest.approx(whole.soc, abs=1e-13)
    assert state.heat_J == pytest.approx(whole.heat_J, rel=1e-9, abs=1e-12)
    assert state.temperature_K == pytest.approx(whole.temperature_K, abs=2e-4)


@pytest.mark.parametrize("name", NAMES)
def test_full_cell_hardly_depends_on_the_split(name: str) -> None:
    coarse, fine = Cell(CELLS[name].parameters), Cell(CELLS[name].parameters)
    for current_A in (2.0, 0.0, -3.0, 0.0):
        a = coarse.step(current_A, 120.0)
        for _ in range(1199):
            fine.step(current_A, 0.1)
        b = fine.step(current_A, 0.1)
        assert a.voltage_V == pytest.approx(b.voltage_V, abs=3e-5)
        assert a.temperature_degC == pytest.approx(b.temperature_degC, abs=5e-3)


def test_an_hour_in_one_step_is_stable() -> None:
    out = Cell(CELLS["nmc"].parameters, soc=0.9).step(-1.0, 3600.0)
    assert out.soc == pytest.approx(0.5, abs=1e-9)
    assert 3.4 < out.voltage_V < 3.8


def test_charge_balance_over_a_mixed_profile() -> None:
    cell = Cell(CELLS["nmc"].parameters, soc=0.5)
    profile = [(2.0, 300.0), (-3.5, 100.0), (0.0, 50.0), (-1.0, 250.0)]
    for current_A, time_s in profile:
        cell.step(current_A, time_s)
    charge_Ah = sum(i * t for i, t in profile) / 3600
    assert cell.state.soc - 0.5 == pytest.approx(charge_Ah / 2.5, abs=1e-12)
    assert cell.state.throughput_Ah == pytest.approx(sum(abs(i) * t for i, t in profile) / 3600, rel=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_energy_balance(name: str) -> None:
    """Terminal work = chemical work + stored in the states + heat (integrated here by the trapezoidal rule)."""
    p = plain(name)
    cell = Cell(p, soc=0.5)
    terminal_J = chemical_J = 0.0
    dt = 0.05
    for current_A, steps in ((2.0, 2000), (-2.0, 3000), (1.0, 1000)):
        before = observe(p, cell.state, current_A)
        for _ in range(steps):
            after = cell.step(current_A, dt)
            terminal_J += current_A * dt * 0.5 * (before.voltage_V + after.voltage_V)
            chemical_J += current_A * dt * 0.5 * (before.open_circuit_V + after.open_circuit_V)
            before = after
    stored_J = sum(
        0.5 * b.time_constant_s / b.resistance_Ohm * v * v
        for b, v in zip((p.fast_1, p.fast_2, p.slow), cell.state.overpotentials_V, strict=True)
    )
    stored_J += p.hysteresis_amplitude_V * 3600 * p.capacity_Ah * cell.state.hysteresis**2 / (2 * p.hysteresis_rate)
    assert terminal_J == pytest.approx(chemical_J + stored_J + cell.state.heat_J, abs=2e-3 * cell.state.heat_J)
    assert cell.state.heat_J > 1.0


def test_heat_warms_the_cell_to_its_steady_state() -> None:
    p = plain(fast_1=Branch(0.0, 1.0), fast_2=Branch(0.0, 1.0), slow=Branch(0.0, 1.0), hysteresis_amplitude_V=0.0)
    cell = Cell(p, soc=0.1, ambient_degC=10.0)
    for _ in range(400):
        cell.step(4.0, 10.0)
        cell.step(-4.0, 10.0)
    assert cell.state.temperature_K - 283.15 == pytest.approx(16.0 * p.ohmic_Ohm / p.heat_transfer_W_per_K, rel=1e-3)
    adiabatic = Cell(replace(p, heat_transfer_W_per_K=0.0), soc=0.5)
    warm = adiabatic.step(4.0, 10.0).temperature_degC - 25.0
    assert warm == pytest.approx(160.0 * p.ohmic_Ohm / p.heat_capacity_J_per_K, rel=1e-9)


def test_hysteresis_follows_the_direction_and_keeps_at_rest() -> None:
    p = plain("lfp")
    cell = Cell(p, soc=0.3)
    after_charge = cell.step(2.5, 1200.0).hysteresis_V
    rested = cell.step(0.0, 7200.0).hysteresis_V
    after_discharge = cell.step(-2.5, 1200.0).hysteresis_V
    assert after_charge == pytest.approx(p.hysteresis_amplitude_V, rel=1e-3)
    assert rested == after_charge
    assert after_discharge == pytest.approx(-p.hysteresis_amplitude_V, rel=1e-3)
    moved = Cell(p, soc=0.3).step(2.5, 3600.0 / p.hysteresis_rate).hysteresis_V
    assert moved == pytest.approx(p.hysteresis_amplitude_V * (1 - math.exp(-1.0)), rel=1e-9)


def test_resistance_follows_arrhenius() -> None:
    p = replace(plain(), activation_K=2500.0)

    def instant_Ohm(temperature_degC: float) -> float:
        cell = Cell(p, ambient_degC=temperature_degC)
        return (cell.step(1.0, 1e-9).voltage_V - cell.step(0.0, 1e-9).voltage_V) / 1.0

    ratio = instant_Ohm(0.0) / instant_Ohm(25.0)
    assert ratio == pytest.approx(math.exp(2500.0 * (1 / 273.15 - 1 / REFERENCE_K)), rel=1e-6)
    assert instant_Ohm(25.0) == pytest.approx(p.ohmic_Ohm, rel=1e-6)


def test_charge_transfer_resistance_falls_with_current() -> None:
    p = plain(charge_transfer_V=0.05, ohmic_Ohm=0.0, exchange_current_A=2.0)
    out = {}
    for current_A in (0.01, 2.0, 8.0):
        cell = Cell(p)
        out[current_A] = (cell.step(current_A, 1e-9).voltage_V - cell.step(0.0, 1e-9).voltage_V) / current_A
    assert out[0.01] == pytest.approx(0.05 / 4.0, rel=1e-4)
    assert out[8.0] == pytest.approx(0.05 * math.asinh(2.0) / 8.0, rel=1e-5)
    assert out[0.01] > out[2.0] > out[8.0]


@pytest.mark.parametrize("current_A,dt_s", [(math.nan, 1.0), (math.inf, 1.0), (1.0, -1.0), (1.0, math.nan)])
def test_impossible_steps_are_refused(current_A: float, dt_s: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        Cell(CELLS["nmc"].parameters).step(current_A, dt_s)


def test_impossible_cells_are_refused() -> None:
    with pytest.raises(ValueError, match="capacity_Ah is 0"):
        plain(capacity_Ah=0.0)
    with pytest.raises(ValueError, match="time_constant_s"):
        plain(slow=Branch(0.01, 0.0))
    with pytest.raises(ValueError, match="ohmic_Ohm is nan"):
        plain(ohmic_Ohm=math.nan)
    with pytest.raises(ValueError, match=r"must lie in 0\.\.1"):
        Cell(CELLS["nmc"].parameters, soc=1.2)
    with pytest.raises(ValueError, match="choose one of nmc, lfp, nimh"):
        cell_type("lead")
