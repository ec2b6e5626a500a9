"""A leak is told by temperature and voltage together, or not at all."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import GridRun
from models.diagnosis.change.leak import named_leak
from models.diagnosis.evidence.candidates import compare_samples, try_effect
from models.diagnosis.evidence.joint import Named
from models.diagnosis.evidence.ranking import rank
from models.diagnosis.reference.samples import choose_samples
from models.effects import effect
from tests.unit.models.diagnosis.hand_reference import EMPTY_V, SLOPE_V, SOC, reference, sure_memory
from tests.unit.models.diagnosis.thermal.warm_runs import BALANCE, warm_run
from tests.unit.models.hand_network import CAPACITY_AH

LEAK_A, NOISE_V = 0.04, 3e-4
NAMES = ("current_offset", "self_discharge", "series_resistance", "voltage_offset")


def leaking(voltage_A: float = LEAK_A, heat_A: float = LEAK_A, drop_Ohm: float = 0.0) -> GridRun:
    """A run whose voltage tells of one leak and whose temperature of another."""
    plain = warm_run()
    open_circuit_V = EMPTY_V + SLOPE_V * (SOC + plain.charge_Ah / CAPACITY_AH)
    warm = warm_run(added_W=heat_A * open_circuit_V)
    drift_V = SLOPE_V * voltage_A * warm.time_s / 3600.0 / CAPACITY_AH
    noise = NOISE_V * np.random.default_rng(7).standard_normal(len(warm))
    return replace(warm, voltage_V=warm.voltage_V - drift_V + drop_Ohm * warm.current_A + noise)


def leak_in(run: GridRun, *names: str) -> tuple[Named, ...]:
    model = reference()
    samples = choose_samples(model, [run], [SOC], 10_000)
    tried = [effect(name) for name in names or NAMES]
    memory = sure_memory([each.name for each in tried], samples, NOISE_V**2, NOISE_V**2)
    comparison = compare_samples(memory, samples, tried)
    ranking = rank(comparison, [try_effect(comparison, each) for each in tried])
    return named_leak(replace(memory, balance=BALANCE), comparison, ranking, [run], [SOC])


def test_a_leak_that_both_channels_show_is_named_before_its_twin() -> None:
    found = leak_in(leaking())
    assert [each.effect_name for each in found] == ["self_discharge"]
    ranking = found[0].ranking
    assert ranking.rivals == ("current_offset",)
    assert ranking.candidates[0].value == pytest.approx(LEAK_A, rel=0.05)


def test_a_contact_that_has_grown_is_named_beside_it() -> None:
    found = leak_in(leaking(drop_Ohm=0.004))
    assert {each.effect_name for each in found} == {"self_discharge", "series_resistance"}
    sizes = [each.ranking.size_V for each in found]
    assert sizes == sorted(sizes, reverse=True)


@pytest.mark.parametrize(
    ("voltage_A", "heat_A"),
    [
        (0.0, LEAK_A),  # warm, but no charge is lost: a sensor of the temperature
        (LEAK_A, 0.0),  # charge is lost and nothing warms: a sensor of the current
        (0.4 * LEAK_A, LEAK_A),  # less than half of what the temperature asks for
        (LEAK_A, -LEAK_A),  # cooler than it was: no leak does that
    ],
)
def test_channels_that_do_not_agree_name_no_leak(voltage_A: float, heat_A: float) -> None:
    assert leak_in(leaking(voltage_A, heat_A)) == ()


def test_a_temperature_that_moves_for_another_reason_too_names_no_leak() -> None:
    """The leak is there, and reversible heat beside it: the leak explains too little of what is new."""
    run = leaking()
    both = warm_run(added_W=LEAK_A * 3.75 + 6e-4 * run.current_A * 295.0)
    assert leak_in(replace(run, temperature_degC=both.temperature_degC)) == ()


def test_without_the_effect_or_an_ambient_temperature_there_is_no_leak() -> None:
    run = leaking()
    assert leak_in(run, "series_resistance", "voltage_offset") == ()
    assert leak_in(replace(run, ambient_degC=None)) == ()
