import json
from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.diagnosis import diagnose, memory_of
from models.diagnosis.answer.findings import Diagnosis
from models.diagnosis.evidence.memory import Memory
from models.diagnosis.reference.reference import Reference
from models.diagnosis.reference.samples import choose_samples
from models.network.model_record import ModelRecord
from simulators.catalogue import CELLS
from simulators.cell import Branch, Cell, CellParameters
from tests.unit.models.diagnosis.cells import SOC, measured, simple_network
from tests.unit.models.simulated_cells import record

CELL = CELLS["nmc"].parameters


@pytest.fixture(scope="module")
def before() -> TimeSeries:
    return measured(CELL, 1)


@pytest.fixture(scope="module")
def memory(before: TimeSeries) -> Memory:
    return memory_of([to_grid(before, 1.0)], [SOC], CELL.capacity_Ah)


@pytest.fixture(scope="module")
def reference(memory: Memory) -> Reference:
    return memory.reference


def diagnosed(memory: Memory, after: TimeSeries, soc: float = SOC) -> Diagnosis:
    return diagnose(simple_network(CELL.capacity_Ah), [after], [soc], mode="change", memory=memory)


def test_reference_model_comes_down_to_the_noise(reference: Reference) -> None:
    assert reference.own_rms_V < 1.15e-3
    samples = choose_samples(reference, [to_grid(measured(CELL, 2), 1.0)], [SOC], 10_000)
    assert samples.share_inside > 0.3
    assert np.sqrt(np.mean(samples.error_V**2)) < 2.5e-3


def test_a_run_on_another_grid_is_refused(reference: Reference, before: TimeSeries) -> None:
    run = to_grid(before, 2.0)
    with pytest.raises(ModelError, match="grid of 2 s"):
        reference.inputs(run, np.arange(4), run.current_A, run.temperature_degC)


def test_overvoltage_is_linear_in_the_current(reference: Reference, before: TimeSeries) -> None:
    run = to_grid(before, 1.0)
    soc, index = SOC + run.charge_Ah / CELL.capacity_Ah, np.arange(0, len(run), 7)
    one = reference.overvoltage_V(run, soc, index, run.current_A)
    two = reference.overvoltage_V(run, soc, index, 2.0 * run.current_A)
    np.testing.assert_allclose(two, 2.0 * one, atol=1e-12)
    assert np.corrcoef(one, run.current_A[index])[0, 1] > 0.95


def test_nothing_is_found_where_nothing_changed(memory: Memory) -> None:
    answer = diagnosed(memory, measured(CELL, 2))
    assert answer.verdict == "nothing_missing"
    assert answer.findings == ()
    assert answer.next_experiment is None


@pytest.mark.parametrize(
    ("cell", "effect", "parameter", "value"),
    [
        (replace(CELL, series_resistance_Ohm=0.006), "series_resistance", "resistance_Ohm", 0.006),
        (replace(CELL, hysteresis_amplitude_V=0.02), "hysteresis", "amplitude_V", 0.016),
    ],
)
def test_a_change_is_named_and_sized(
    memory: Memory, cell: CellParameters, effect: str, parameter: str, value: float
) -> None:
    answer = diagnosed(memory, measured(cell, 2))
    first = answer.findings[0]
    assert (first.effect, first.rank) == (effect, 1)
    assert first.parameters[parameter].value == pytest.approx(value, rel=0.1)
    assert first.parameters[parameter].std is not None
    assert first.confidence > 0.5
    assert first.explanation.startswith(first.explanation[0].upper())


def test_a_smaller_capacity_is_told_at_least_beside_the_curve_that_could_stand_for_it(memory: Memory) -> None:
    answer = diagnosed(memory, measured(replace(CELL, capacity_Ah=2.3), 2))
    first = [each.effect for each in answer.findings[:2]]
    assert "capacity" in first
    assert first[0] == "capacity" or (first[0] == "ocv_shape" and answer.verdict == "ambiguous")
    found = answer.findings[first.index("capacity")]
    assert found.parameters["capacity_Ah"].value == pytest.approx(2.3, rel=0.05)


def test_an_offset_of_the_current_and_a_leak_name_each_other(memory: Memory) -> None:
    answer = diagnosed(memory, measured(CELL, 2, current_error_A=0.02))
    assert answer.verdict == "ambiguous"
    assert {each.effect for each in answer.findings[:2]} == {"current_offset", "self_discharge"}
    assert set(answer.findings[0].confounded_with) >= {"current_offset", "self_discharge"} - {answer.findings[0].effect}
    assert answer.next_experiment is not None
    assert answer.next_experiment["criterion"] == "discriminate"
    assert set(answer.next_experiment["rivals"]) == {"current_offset", "self_discharge"}
    drift = next(each for each in answer.findings if each.effect == "current_offset")
    assert drift.parameters["offset_A"].value == pytest.approx(0.02, rel=0.1)


def test_a_leak_that_warms_the_cell_is_no_wrong_temperature_reading(memory: Memory) -> None:
    answer = diagnosed(memory, measured(replace(CELL, leakage_A=0.05), 2))
    assert "temperature_sensor" not in {each.effect for each in answer.findings}
    assert answer.findings[0].effect == "self_discharge"
    assert answer.findings[0].confounded_with == ("current_offset",)
    assert answer.findings[0].parameters["leakage_A"].value == pytest.approx(0.05, rel=0.1)


def test_a_wrong_temperature_reading_beside_a_wrong_current_is_no_leak(memory: Memory) -> None:
    after = measured(CELL, 2, current_error_A=0.02)
    answer = diagnosed(memory, replace(after, temperature_degC=after.temperature_degC + 1.5))
    assert {"temperature_sensor", "current_offset"} <= {each.effect for each in answer.findings}


def test_two_changes_are_named_together_and_sized(memory: Memory) -> None:
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
    assert named[1].error_after_mV < named[0].error_after_mV
    assert [each.evidence["beside"] for each in named] == [[], [named[0].effect]]


@pytest.mark.parametrize("seed", [2, 4])
def test_two_small_effects_go_before_a_curve_that_imitates_both(memory: Memory, seed: int) -> None:
    after = measured(CELL, seed, current_error_A=0.04)
    answer = diagnosed(memory, replace(after, voltage_V=after.voltage_V - 0.01))
    found = {each.effect: each for each in answer.findings}
    assert set(found) == {"current_offset", "self_discharge", "voltage_offset"}
    assert found["current_offset"].parameters["offset_A"].value == pytest.approx(0.04, rel=0.1)
    assert found["voltage_offset"].parameters["offset_V"].value == pytest.approx(-0.01, rel=0.1)


def test_two_small_effects_where_the_curve_is_hardly_known_are_not_told_surely(memory: Memory) -> None:
    """The run is mostly at states of charge that the training run has not seen."""
    after = measured(CELL, 3, current_error_A=0.04)
    answer = diagnosed(memory, replace(after, voltage_V=after.voltage_V - 0.01))
    assert answer.verdict == "ambiguous"
    assert answer.findings[0].confidence < 0.5
    assert {"voltage_offset", "current_offset"} <= {each.effect for each in answer.findings}


def discharged(cell: CellParameters, seed: int) -> TimeSeries:
    """Constant current and nothing else."""
    current = np.full(1900, -1.5)
    current[0] = 0.0
    return replace(record(Cell(cell, 0.8, 22.0), current, seed), name="discharge")


def test_a_constant_current_alone_leaves_rivals_and_the_next_experiment_settles_them(memory: Memory) -> None:
    cell = replace(CELL, slow=Branch(0.03, 900.0))
    alone = diagnosed(memory, discharged(cell, 3), 0.8)
    assert alone.verdict == "ambiguous"
    assert "relaxation" in {each.effect for each in alone.findings}
    assert alone.findings[0].confidence < 0.7
    request = alone.next_experiment
    assert request is not None and request["criterion"] == "discriminate"
    # What it asks for: both directions and rests, inside its limits.
    further = measured(cell, 2)
    low, high = request["limits"]["current_A"]
    assert low <= further.current_A.min() and further.current_A.max() <= high
    both = diagnose(
        simple_network(CELL.capacity_Ah), [discharged(cell, 3), further], [0.8, SOC], memory=memory, mode="change"
    )
    assert (both.verdict, both.findings[0].effect) == ("missing", "relaxation")


def test_a_nearly_linear_charge_transfer_is_a_rival_of_a_resistance(memory: Memory) -> None:
    # At these currents its asinh is a straight line to 0.1 %.
    cell = replace(CELL, exchange_current_A=60.0, charge_transfer_V=0.0514 + 0.1)
    plain = replace(CELL, exchange_current_A=60.0)
    known = memory_of([to_grid(measured(plain, 1), 1.0)], [SOC], CELL.capacity_Ah)
    answer = diagnosed(known, measured(cell, 2))
    names = {answer.findings[0].effect, *answer.findings[0].confounded_with}
    assert answer.verdict == "ambiguous"
    assert names >= {"series_resistance", "charge_transfer"}


def test_a_wrong_temperature_reading_is_seen_in_the_temperature(memory: Memory) -> None:
    after = measured(CELL, 2)
    assert after.ambient_degC is not None
    wrong = after.ambient_degC + 0.5 * (after.temperature_degC - after.ambient_degC)
    answer = diagnosed(memory, replace(after, temperature_degC=wrong))
    first = answer.findings[0]
    assert first.effect == "temperature_sensor"
    assert first.parameters["gain"].value == pytest.approx(0.5, rel=0.1)
    assert first.evidence["error_after_K"] < 0.3 * first.evidence["error_before_K"]


def test_two_effects_on_the_temperature_are_named_together(memory: Memory) -> None:
    cell = replace(CELL, heat_transfer_W_per_K=0.5 * CELL.heat_transfer_W_per_K, reversible_heat_V_per_K=3e-4)
    answer = diagnosed(memory, measured(cell, 2))
    found = {each.effect: each for each in answer.findings}
    assert set(found) == {"heat_transfer", "reversible_heat"}
    half = found["heat_transfer"].parameters["heat_transfer_W_per_K"].value
    assert half == pytest.approx(0.5 * CELL.heat_transfer_W_per_K, rel=0.15)
    assert found["reversible_heat"].parameters["dU_dT_V_per_K"].value == pytest.approx(3e-4, rel=0.15)


def test_one_effect_on_the_temperature_is_not_made_two(memory: Memory) -> None:
    answer = diagnosed(memory, measured(replace(CELL, reversible_heat_V_per_K=3e-4), 2))
    assert [each.effect for each in answer.findings] == ["reversible_heat"]


def test_the_answer_has_every_field_of_the_contract(memory: Memory) -> None:
    answer = diagnosed(memory, measured(replace(CELL, series_resistance_Ohm=0.006), 2)).to_json()
    assert set(answer) >= {
        "verdict", "mode", "findings", "noise_floor_mV", "unexplained_mV", "depends_on", "next_experiment", "seconds",
    }  # fmt: skip
    finding = answer["findings"][0]
    assert set(finding) >= {
        "effect", "rank", "error_before_mV", "error_after_mV", "explained_share", "confidence", "parameters",
        "confounded_with", "explanation",
    }  # fmt: skip
    assert set(finding["parameters"]["resistance_Ohm"]) == {"value", "std", "unit"}
    share = 1.0 - (finding["error_after_mV"] / finding["error_before_mV"]) ** 2
    assert finding["explained_share"] == pytest.approx(share)


def test_the_memory_of_the_training_runs_survives_as_json(memory: Memory) -> None:
    document = json.loads(json.dumps(memory.to_json(), allow_nan=False))
    after = measured(replace(CELL, series_resistance_Ohm=0.006), 2)
    network = simple_network(CELL.capacity_Ah)
    network = replace(network, record=ModelRecord(diagnosis=document))
    again = diagnose(network, [after], [SOC], mode="change").findings[0]
    first = diagnosed(memory, after).findings[0]
    assert again.effect == first.effect
    value = first.parameters["resistance_Ohm"].value
    assert again.parameters["resistance_Ohm"].value == pytest.approx(value, rel=1e-3)


@pytest.mark.parametrize("broken", [{"kind": "other"}, {"coefficients": [1.0]}, {"layout": None}, {"sizes": [3]}])
def test_a_damaged_memory_is_refused(memory: Memory, broken: dict) -> None:
    with pytest.raises(ModelError, match="fit the model again"):
        Memory.from_json(memory.to_json() | broken)


def test_bad_calls_are_refused() -> None:
    network = simple_network(2.5)
    with pytest.raises(ModelError, match="no run"):
        diagnose(network, [], [])
    short = TimeSeries(np.arange(300.0), np.zeros(300), np.full(300, 3.6), np.full(300, 22.0))
    with pytest.raises(ModelError, match="SoC at the start"):
        diagnose(network, [short], [0.5], train=[short], mode="change")
