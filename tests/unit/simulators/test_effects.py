"""Each effect moves what its name says."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from simulators.catalogue import CELLS
from simulators.cell import Cell, contact_is_bad
from simulators.effects import EFFECTS, apply_effects
from simulators.sensors import Measurement, SensorParameters, Sensors

QUIET = SensorParameters(
    voltage_noise_V=0, current_noise_A=0, temperature_noise_K=0,
    voltage_resolution_V=0, current_resolution_A=0, temperature_resolution_K=0,
)  # fmt: skip
Profile = list[tuple[float, float]]


def play(effects: dict[str, float], profile: Profile, ambient_degC: float = 25.0) -> Measurement:
    """Return the last measurement of an NMC cell that plays (current, time) pairs."""
    parameters, sensors = apply_effects(CELLS["nmc"].parameters, QUIET, effects)
    cell = Cell(parameters, soc=0.5, ambient_degC=ambient_degC)
    device = Sensors(sensors, np.random.default_rng(0))
    truth = cell.step(0.0, 0.0)
    for current_A, time_s in profile:
        truth = cell.step(current_A, time_s)
    return device.measure(truth, profile[-1][0], ambient_degC)


def volts(effects: dict[str, float], profile: Profile, ambient_degC: float = 25.0) -> float:
    """Return the last voltage in volt."""
    return play(effects, profile, ambient_degC).voltage_V


PULSE: Profile = [(2.0, 1e-6)]


def moved_by(name: str, value: float, profile: Profile, ambient_degC: float = 25.0, reference: float = 0.0) -> float:
    """Return how far an effect alone, not the warmth it makes, moves the last voltage against a reference value."""
    isothermal = {"temperature_dependence": 0.0, "heat_transfer": 1e6}
    changed, unchanged = ({**isothermal, name: v} for v in (value, reference))
    return volts(changed, profile, ambient_degC) - volts(unchanged, profile, ambient_degC)


ARRHENIUS = 1 / 273.15 - 1 / 298.15
CASES: dict[str, tuple[Callable[[], float], float]] = {
    "hysteresis": (lambda: moved_by("hysteresis", 0.02, [(2.0, 1800.0), (0.0, 1.0)]), 0.02),
    "relaxation": (lambda: moved_by("relaxation", 0.01, [(2.0, 1000.0)]) / (1 - math.exp(-1000 / 900)), 0.02),
    "charge_transfer": (lambda: moved_by("charge_transfer", 0.05, PULSE), 0.05 * math.asinh(0.2)),
    "series_resistance": (lambda: moved_by("series_resistance", 0.01, PULSE), 0.02),
    "soc_dependence": (lambda: moved_by("soc_dependence", 0.1, PULSE), 0.2 * math.exp(-0.5 / 0.15)),
    "voltage_offset": (lambda: moved_by("voltage_offset", 0.003, PULSE), 0.003),
    "voltage_gain": (lambda: moved_by("voltage_gain", 0.01, [(0.0, 1.0)]) / volts({}, [(0.0, 1.0)]), 0.01),
    "current_gain": (
        lambda: play({"current_gain": 0.02}, PULSE).current_A - play({"current_gain": 0.0}, PULSE).current_A,
        0.04,
    ),
    # Bad at first, good after twenty minutes.
    "intermittent_contact": (lambda: moved_by("intermittent_contact", 0.01, PULSE), 0.02),
    "entropic_voltage": (lambda: moved_by("entropic_voltage", 5e-4, [(0.0, 1.0)], 45.0), 0.01),
    "exchange_current": (
        lambda: moved_by("exchange_current", 1.25, PULSE, reference=5.0),
        0.0514 * (math.asinh(0.8) - math.asinh(0.2)),
    ),
    "charge_discharge_asymmetry": (
        lambda: moved_by("charge_discharge_asymmetry", 1.5, [(0.5, 1e-6)], reference=1.0),
        0.5 * 0.5 * (0.020 + 0.006 * math.exp(-0.5 / 0.15) + 0.0514 / 10),
    ),
    "current_offset": (
        lambda: play({"current_offset": 0.05}, PULSE).current_A - play({"current_offset": 0.0}, PULSE).current_A,
        0.05,
    ),
    "temperature_sensor": (
        lambda: play({"temperature_sensor": 2.0}, PULSE).temperature_degC - play({}, PULSE).temperature_degC,
        2.0,
    ),
    "temperature_dependence": (
        lambda: (
            volts({"temperature_dependence": 3000.0, "charge_transfer": 0.0, "soc_dependence": 0.0}, PULSE, 0.0)
            - volts({"temperature_dependence": 0.0, "charge_transfer": 0.0, "soc_dependence": 0.0}, PULSE, 0.0)
        ),
        2.0 * 0.020 * (math.exp(3000 * ARRHENIUS) - 1),
    ),
}


@pytest.mark.parametrize("name", sorted(CASES))
def test_effect_moves_what_its_name_says(name: str) -> None:
    measured, expected = CASES[name]
    assert measured() == pytest.approx(expected, rel=0.02)


def test_effects_on_charge() -> None:
    def soc(effects: dict[str, float], current_A: float) -> float:
        parameters, _ = apply_effects(CELLS["nmc"].parameters, QUIET, effects)
        return Cell(parameters, soc=0.5).step(current_A, 3600.0).soc

    assert soc({"capacity": 2.0}, 0.5) == pytest.approx(0.75, abs=1e-9)
    assert soc({"self_discharge": 0.25}, 0.0) == pytest.approx(0.4, abs=1e-9)


def test_resistance_growth_counts_throughput() -> None:
    parameters, _ = apply_effects(CELLS["nmc"].parameters, QUIET, {"resistance_growth": 0.1, "charge_transfer": 0.0})
    cell = Cell(parameters, soc=0.5)

    def instant_V() -> float:
        return cell.step(1.0, 1e-9).voltage_V - cell.step(0.0, 1e-9).voltage_V

    fresh = instant_V()
    for _ in range(50):
        cell.step(2.0, 360.0)
        cell.step(-2.0, 360.0)
    cell.step(0.0, 36000.0)
    assert cell.state.throughput_Ah == pytest.approx(20.0, rel=1e-6)
    assert instant_V() / fresh == pytest.approx(3.0, rel=0.01)


def test_effects_on_heat() -> None:
    cycle: Profile = [(3.0, 60.0), (-3.0, 60.0)] * 40
    base = play({}, cycle).temperature_degC
    assert play({"heat_transfer": 0.05}, cycle).temperature_degC > base + 2.0
    reversible = (
        play({"reversible_heat": 1e-3}, [(2.0, 100.0)]).temperature_degC - play({}, [(2.0, 100.0)]).temperature_degC
    )
    assert reversible == pytest.approx(2.0 * 298.15 * 1e-3 * 100.0 / 45.0, rel=0.15)


def test_a_contact_comes_and_goes() -> None:
    bad = [contact_is_bad(10.0 * k) for k in range(1000)]
    assert 0.2 < np.mean(bad) < 0.4
    assert np.count_nonzero(np.diff(bad)) > 10
    gone: Profile = [(0.0, 1200.0), *PULSE]
    assert not contact_is_bad(1200.0)
    assert moved_by("intermittent_contact", 0.01, gone) == 0.0


def test_a_core_that_is_warmer_resists_less_than_its_case_tells() -> None:
    cycle: Profile = [(3.0, 60.0), (-3.0, 60.0)] * 10
    cold, warm = (volts({"core_temperature": each}, [*cycle, (3.0, 1.0)]) for each in (0.0, 5.0))
    assert 1e-3 < cold - warm < 0.05


@pytest.mark.parametrize("name", ["nmc", "lfp"])
def test_electrodes_age_from_the_fresh_cell(name: str) -> None:
    fresh, quiet = CELLS[name].parameters, SensorParameters()
    assert apply_effects(fresh, quiet, {"lithium_loss": 0.0})[0] == fresh
    slipped, _ = apply_effects(fresh, quiet, {"lithium_loss": 0.1})
    shrunk, _ = apply_effects(fresh, quiet, {"active_material_loss": 0.1})
    assert slipped.capacity_Ah == pytest.approx(0.9 * fresh.capacity_Ah)
    assert shrunk.capacity_Ah == pytest.approx(0.95 * fresh.capacity_Ah)
    # The negative electrode's step comes as much charge after empty as before, or sooner where there is less of it.
    first = fresh.open_circuit.steps[0].centre
    assert slipped.open_circuit.steps[0].centre * 0.9 == pytest.approx(first)
    assert shrunk.open_circuit.steps[0].centre * 0.95 == pytest.approx(0.9 * first)
    # Full is where it was: what the positive electrode has given when it is.
    assert slipped.open_circuit.voltage_V(1.0) == pytest.approx(fresh.open_circuit.voltage_V(1.0), abs=2e-3)


def test_every_effect_is_covered() -> None:
    others = {"capacity", "self_discharge", "resistance_growth", "heat_transfer", "reversible_heat"}
    others |= {"core_temperature", "lithium_loss", "active_material_loss"}
    assert set(CASES) | others == set(EFFECTS)


def test_unknown_effect_lists_the_names() -> None:
    with pytest.raises(ValueError, match=r"unknown effect 'hysterisis'.*hysteresis.*voltage_offset"):
        apply_effects(CELLS["nmc"].parameters, QUIET, {"hysterisis": 0.01})


@pytest.mark.parametrize(
    "name,value", [("capacity", 0.0), ("relaxation", math.nan), ("voltage_offset", math.inf), ("lithium_loss", 1.0)]
)
def test_impossible_value_names_the_effect(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"effect {name}={value}"):
        apply_effects(CELLS["nmc"].parameters, QUIET, {name: value})
