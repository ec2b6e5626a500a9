import json
from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.diagnosis import diagnose
from models.diagnosis.answer.findings import Diagnosis
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.known.record import from_json, to_json
from models.diagnosis.likelihood.analysis import analyse
from models.diagnosis.likelihood.learning import know
from models.diagnosis.likelihood.values import values_of
from models.effects import effect, effects
from models.identification.bounded.variants import Variant
from models.network.model_record import ModelRecord
from simulators.catalogue import CELLS
from simulators.cell import Branch, Cell, CellParameters
from tests.unit.models.diagnosis.cells import SOC, measured, simple_network
from tests.unit.models.simulated_cells import pulses_A, record

CELL = CELLS["nmc"].parameters
COLUMNS = ("time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC")


@pytest.fixture(scope="module")
def before() -> TimeSeries:
    return measured(CELL, 1)


@pytest.fixture(scope="module")
def memory(before: TimeSeries) -> KnownRuns:
    return know([to_grid(before, 1.0)], [SOC], CELL.capacity_Ah, list(effects().values()), Variant())


def diagnosed(memory: KnownRuns, after: TimeSeries, soc: float = SOC, soc_std: float | None = None) -> Diagnosis:
    stds = None if soc_std is None else [soc_std]
    return diagnose(simple_network(CELL.capacity_Ah), [after], [soc], mode="change", memory=memory, soc_std=stds)


def test_nothing_is_found_where_nothing_changed(memory: KnownRuns) -> None:
    answer = diagnosed(memory, measured(CELL, 2))
    assert answer.verdict == "nothing_missing"
    assert answer.findings == ()
    assert answer.next_experiment is None


@pytest.mark.parametrize(
    ("cell", "name", "parameter", "value"),
    [
        (replace(CELL, series_resistance_Ohm=0.006), "series_resistance", "resistance_Ohm", 0.006),
        pytest.param(
            replace(CELL, hysteresis_amplitude_V=0.02), "hysteresis", "amplitude_V", 0.016, marks=pytest.mark.proof
        ),
    ],
)
def test_a_change_is_named_and_sized(
    memory: KnownRuns, cell: CellParameters, name: str, parameter: str, value: float
) -> None:
    answer = diagnosed(memory, measured(cell, 2))
    first = answer.findings[0]
    assert (first.effect, first.rank) == (name, 1)
    found = first.parameters[parameter]
    assert found.std is not None and found.std < 0.5 * value
    assert abs(found.value - value) < 2.5 * found.std
    assert first.confidence > 0.5
    assert first.explanation.startswith(first.explanation[0].upper())


@pytest.mark.proof
@pytest.mark.parametrize("capacity_Ah", [2.3, 2.1])
def test_a_smaller_capacity_is_told_from_a_moved_curve(memory: KnownRuns, capacity_Ah: float) -> None:
    """The smaller goes out of the trained state of charge, where the curve is not known."""
    answer = diagnosed(memory, measured(replace(CELL, capacity_Ah=capacity_Ah), 2))
    assert answer.findings[0].effect == "capacity"
    assert answer.findings[0].parameters["capacity_Ah"].value == pytest.approx(capacity_Ah, rel=0.02)


@pytest.mark.parametrize("delay_s", [0.4, *(pytest.param(each, marks=pytest.mark.proof) for each in (1.0, 2.0))])
def test_a_delay_is_found_by_simulation(memory: KnownRuns, delay_s: float) -> None:
    run = measured(CELL, 2)
    late = replace(run, voltage_V=np.interp(run.time_s - delay_s, run.time_s, run.voltage_V))
    answer = diagnosed(memory, late)
    assert answer.findings[0].effect == "dead_time"
    assert answer.findings[0].parameters["delay_s"].value == pytest.approx(delay_s, abs=0.1)


@pytest.mark.proof
def test_a_start_that_nobody_is_sure_of_is_no_news(memory: KnownRuns) -> None:
    run, off = measured(CELL, 2), SOC + 0.04
    assert "initial_soc" in {each.effect for each in diagnosed(memory, run, off).findings[:2]}
    assert diagnosed(memory, run, off, soc_std=0.05).verdict == "nothing_missing"


@pytest.mark.proof
def test_an_offset_of_the_current_and_a_leak_name_each_other(memory: KnownRuns) -> None:
    answer = diagnosed(memory, measured(CELL, 2, current_error_A=0.02))
    assert answer.verdict == "ambiguous"
    assert {each.effect for each in answer.findings[:2]} == {"current_offset", "self_discharge"}
    assert set(answer.findings[0].confounded_with) >= {"current_offset", "self_discharge"} - {answer.findings[0].effect}
    assert answer.next_experiment is not None
    assert answer.next_experiment["criterion"] == "discriminate"
    assert set(answer.next_experiment["rivals"]) == {"current_offset", "self_discharge"}
    drift = next(each for each in answer.findings if each.effect == "current_offset")
    assert drift.parameters["offset_A"].value == pytest.approx(0.02, rel=0.2)


@pytest.mark.proof
def test_a_contact_that_comes_and_goes_is_named_and_sized(memory: KnownRuns) -> None:
    run = measured(CELL, 2)
    bad = np.sin(run.time_s / 380.0) > 0.5
    answer = diagnosed(memory, replace(run, voltage_V=run.voltage_V + 0.008 * bad * run.current_A))
    assert answer.findings[0].effect == "intermittent_contact"
    assert answer.findings[0].parameters["resistance_Ohm"].value == pytest.approx(0.008, rel=0.1)


@pytest.mark.proof
def test_a_gain_of_the_current_is_told_from_another_capacity_by_its_heat(memory: KnownRuns) -> None:
    run = measured(CELL, 2)
    first = diagnosed(memory, replace(run, current_A=1.04 * run.current_A)).findings[0]
    assert first.effect == "current_gain"
    assert first.parameters["gain"].value == pytest.approx(0.04, rel=0.2)


def test_what_is_granted_from_run_to_run_is_not_learned_of_effects_that_others_stand_for(memory: KnownRuns) -> None:
    known = set(memory.elsewhere.granted)
    assert {"capacity", "voltage_offset", "ocv_shape"} <= known
    assert not known & {each.name for each in effects().values() if not each.expected.learned}


def test_either_electrode_is_tried_and_told_by_its_name(memory: KnownRuns) -> None:
    found = analyse(memory, [to_grid(measured(CELL, 2), 1.0)], [SOC], None, [effect("active_material_loss")])
    (tried,) = found.tried
    name, left = values_of(found, tried).items()
    assert name[0] in ("share_lost of the negative electrode", "share_lost of the positive electrode")
    # Nothing is lost here.
    assert left[0] == "capacity_Ah"
    assert left[1].value == pytest.approx(CELL.capacity_Ah, rel=0.02)


@pytest.mark.proof
def test_a_leak_that_warms_the_cell_is_no_wrong_temperature_reading(memory: KnownRuns) -> None:
    answer = diagnosed(memory, measured(replace(CELL, leakage_A=0.05), 2))
    assert "temperature_sensor" not in {each.effect for each in answer.findings}
    assert answer.findings[0].effect == "self_discharge"
    assert answer.findings[0].confounded_with == ("current_offset",)
    assert answer.findings[0].parameters["leakage_A"].value == pytest.approx(0.05, rel=0.1)


def test_two_changes_are_named_together_and_sized(memory: KnownRuns) -> None:
    cell = replace(CELL, hysteresis_amplitude_V=0.016)
    answer = diagnosed(memory, measured(cell, 2, current_error_A=0.03))
    named = [
        each
        for k, each in enumerate(answer.findings)
        if not any(each.effect in earlier.confounded_with for earlier in answer.findings[:k])
    ]
    names = {each.effect for each in named}
    assert "hysteresis" in names and names & {"current_offset", "self_discharge"} and len(names) == 2
    loop = next(each for each in named if each.effect == "hysteresis")
    assert loop.parameters["amplitude_V"].value == pytest.approx(0.012, rel=0.15)
    # Each finding starts from the error of the runs, and says what it leaves beside those before it.
    assert named[0].error_before_mV == named[1].error_before_mV
    assert named[1].error_after_mV == answer.unexplained_mV != named[0].error_after_mV
    assert [each.evidence["beside"] for each in named] == [[], [named[0].effect]]


def test_a_constant_current_alone_leaves_rivals_and_asks_for_an_experiment(memory: KnownRuns) -> None:
    current = np.full(1900, -1.5)
    current[0] = 0.0
    worn = Cell(replace(CELL, slow=Branch(0.08, 900.0)), 0.8, 22.0)
    alone = diagnosed(memory, replace(record(worn, current, 3), name="discharge"), 0.8)
    assert alone.verdict in ("ambiguous", "unknown_effect", "nothing_missing")
    assert all(each.confidence < 0.9 for each in alone.findings)
    if alone.verdict == "ambiguous":
        request = alone.next_experiment
        assert request is not None and request["criterion"] == "discriminate"


def test_a_log_may_begin_anywhere(memory: KnownRuns) -> None:
    """In a pulse or a relaxation, on either branch of the loop."""
    after = measured(CELL, 2)
    charge_Ah = np.cumsum(after.current_A) / 3600.0
    for first in (1203, 1777):
        cut = TimeSeries(*(getattr(after, name)[first:] for name in COLUMNS), name="cut")
        answer = diagnosed(memory, cut, SOC + float(charge_Ah[first]) / CELL.capacity_Ah)
        assert answer.verdict == "nothing_missing"
        told = answer.to_json()["power"]
        assert len(answer.hides_best) == 3 and {"effect", "size", "unit", "rms_mV", "rms_K"} == set(told[0])
        shown = {each["effect"]: each for each in told}
        # A volt more is a volt more, everywhere.
        offset = shown["voltage_offset"]
        assert offset["rms_mV"] == pytest.approx(1e3 * offset["size"])
        # A contact that was bad now and then would have been found from some size on.
        assert 0.0 < shown["intermittent_contact"]["size"] < 0.1


def test_a_wrong_temperature_reading_is_seen_in_the_temperature(memory: KnownRuns) -> None:
    after = measured(CELL, 2)
    assert after.ambient_degC is not None
    wrong = after.ambient_degC + 0.5 * (after.temperature_degC - after.ambient_degC)
    answer = diagnosed(memory, replace(after, temperature_degC=wrong))
    first = answer.findings[0]
    assert first.effect == "temperature_sensor"
    assert first.parameters["gain"].value == pytest.approx(0.5, rel=0.15)
    assert first.evidence["error_after_K"] < 0.3 * first.evidence["error_before_K"]


def test_a_reading_that_stands_still_has_no_gain_below_that_of_any_sensor(memory: KnownRuns) -> None:
    after = measured(CELL, 2)
    still = replace(after, temperature_degC=np.full(len(after), 25.0), ambient_degC=np.full(len(after), 25.0))
    found = analyse(memory, [to_grid(still, 1.0)], [SOC], None, [effect("temperature_sensor")])
    (tried,) = found.tried
    assert values_of(found, tried)["gain"].value >= 0.1


@pytest.mark.proof
def test_a_heat_that_turns_with_the_current_is_told_with_the_cause_that_it_may_have(memory: KnownRuns) -> None:
    answer = diagnosed(memory, measured(replace(CELL, reversible_heat_V_per_K=3e-4), 2))
    found = {each.effect: each for each in answer.findings}
    assert set(found) == {"reversible_heat", "entropic_voltage"}
    value = found["reversible_heat"].parameters["dU_dT_V_per_K"]
    assert value.std is not None and abs(value.value - 3e-4) < 2.5 * value.std


def test_the_answer_has_every_field_of_the_contract(memory: KnownRuns) -> None:
    answer = diagnosed(memory, measured(replace(CELL, series_resistance_Ohm=0.006), 2)).to_json()
    assert set(answer) >= {
        "verdict", "mode", "findings", "noise_floor_mV", "unexplained_mV", "depends_on", "next_experiment", "seconds",
        "power", "hides_best",
    }  # fmt: skip
    finding = answer["findings"][0]
    assert set(finding) >= {
        "effect", "rank", "error_before_mV", "error_after_mV", "explained_share", "confidence", "parameters",
        "confounded_with", "explanation",
    }  # fmt: skip
    assert set(finding["parameters"]["resistance_Ohm"]) == {"value", "std", "unit"}
    share = 1.0 - (finding["error_after_mV"] / finding["error_before_mV"]) ** 2
    assert finding["explained_share"] == pytest.approx(share)


def test_the_memory_of_the_training_runs_survives_as_json(memory: KnownRuns) -> None:
    document = json.loads(json.dumps(to_json(memory), allow_nan=False))
    after = measured(replace(CELL, series_resistance_Ohm=0.006), 2)
    network = simple_network(CELL.capacity_Ah)
    network = replace(network, record=ModelRecord(diagnosis=document))
    again = diagnose(network, [after], [SOC], mode="change").findings[0]
    first = diagnosed(memory, after).findings[0]
    assert again.effect == first.effect
    value = first.parameters["resistance_Ohm"].value
    assert again.parameters["resistance_Ohm"].value == pytest.approx(value, rel=1e-3)


@pytest.mark.parametrize("broken", [{"kind": "other"}, {"coefficients": [1.0]}, {"knots": None}, {"left_V": [3.0]}])
def test_a_damaged_memory_is_refused(memory: KnownRuns, broken: dict) -> None:
    with pytest.raises(ModelError, match="fit the model again"):
        from_json(to_json(memory) | broken)


def test_bad_calls_are_refused() -> None:
    network = simple_network(2.5)
    with pytest.raises(ModelError, match="no run"):
        diagnose(network, [], [])
    short = TimeSeries(np.arange(300.0), np.zeros(300), np.full(300, 3.6), np.full(300, 22.0))
    with pytest.raises(ModelError, match="SoC at the start"):
        diagnose(network, [short], [0.5], train=[short], mode="change")


def grown(current_A: FloatArray, soc: float, growth_per_Ah: float = 0.12) -> TimeSeries:
    return record(Cell(replace(CELL, resistance_growth_per_Ah=growth_per_Ah), soc, 22.0), current_A, 3)


@pytest.mark.proof
def test_growth_is_named_where_the_state_of_charge_comes_back(memory: KnownRuns) -> None:
    first = diagnosed(memory, grown(pulses_A(6000, CELL.capacity_Ah, 2), SOC)).findings[0]
    assert first.effect == "resistance_growth"
    assert first.parameters["growth_per_Ah"].value == pytest.approx(0.12, rel=0.1)


@pytest.mark.proof
def test_in_one_discharge_growth_is_not_claimed_but_told_as_what_it_may_be_as_well(memory: KnownRuns) -> None:
    falling_A = CELL.capacity_Ah * np.random.default_rng(5).uniform(-2.0, 0.4, 150).repeat(20)
    answer = diagnosed(memory, grown(falling_A, 0.8, 0.18), 0.8)
    assert answer.verdict == "ambiguous"
    first = answer.findings[0]
    assert first.effect != "resistance_growth" and "resistance_growth" in first.confounded_with
    chance = {each.effect: each.confidence for each in answer.findings}
    assert 0.0 < chance["resistance_growth"] <= 0.5
    assert answer.next_experiment is not None and "resistance_growth" in answer.next_experiment["rivals"]
    # Of no size: that one discharge tells it from nothing is not promised.
    assert [each.size for each in answer.power if each.effect == "resistance_growth"] == [None]
    assert "resistance_growth" not in answer.hides_best
