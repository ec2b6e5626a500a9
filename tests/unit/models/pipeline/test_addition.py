"""Effects that are added to a bounded network, which is fitted again with its bounds."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from models.comparison import compare
from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.data.run_order import run_order
from models.data.timeseries import TimeSeries
from models.diagnosis import memory_of, own_variant
from models.diagnosis.known.record import known_in
from models.network.lineage import run_sha256, version_of
from models.pipeline.addition import Addition, add_effect
from models.pipeline.bounded_refit import remembers
from models.readouts.tables import summary
from tests.unit.models.diagnosis.cells import SOC, measured
from tests.unit.models.pipeline.bounded_cell import CELL, fitted, run


def part(whole: TimeSeries, first: int, end: int) -> TimeSeries:
    """Samples first..end of a run as a run of their own."""
    columns = (whole.current_A, whole.voltage_V, whole.temperature_degC)
    return TimeSeries(
        whole.time_s[first:end] - whole.time_s[first], *(each[first:end] for each in columns), name="part"
    )


def added(name: str, without: tuple[str, ...]) -> Addition:
    return add_effect(fitted(without=without).network, name, [run(2), run(4)], [SOC, SOC], [run(9)], [SOC])


def test_an_effect_that_was_left_out_is_put_in_with_bounds() -> None:
    made = added("hysteresis", ("hysteresis",))
    assert made.after.overall_mV < 0.5 * made.before.overall_mV
    network = made.network
    assert network.structure.name == "bounded+hysteresis" and network.structure.kernel == "hat"
    choices, version = network.record.choices, version_of(network)
    assert choices is not None and choices["family"] == "bounded" and choices["without"] == []
    assert any("hysteresis" in term["effects"] for term in choices["terms"])
    assert version is not None and (version.number, version.made_by) == (2, "effect")
    # A network's loop is told as the network has it, whatever the runs show to first order.
    assert made.parameters["amplitude_V"].value == pytest.approx(0.02, rel=0.5)
    gap_V = summary(network)["hysteresis_V"]
    assert gap_V is not None and made.parameters["amplitude_V"].value == pytest.approx(0.5 * gap_V)


@pytest.mark.proof
def test_its_errors_are_those_of_a_comparison_wherever_the_judged_run_begins() -> None:
    whole = run(9)
    first = int(np.argmax(np.abs(whole.current_A[500:2000]))) + 500
    soc = SOC + float(whole.current_A[1 : first + 1].sum()) / (3600.0 * CELL.capacity_Ah)
    late = part(whole, first, 3000)
    parent = fitted(without=("hysteresis",)).network
    made = add_effect(parent, "hysteresis", [run(2), run(4)], [SOC, SOC], [late], [soc])
    for network, error_mV in ((parent, made.before.overall_mV), (made.network, made.after.overall_mV)):
        assert compare(network, [late], [soc])["overall"]["rmse_mV"] == pytest.approx(error_mV, rel=1e-9)


@pytest.mark.proof
def test_others_stay_left_out_where_runs_are_corrected() -> None:
    made = added("current_offset", ("hysteresis",))
    assert made.network.structure.name == "bounded+current_offset"
    choices = made.network.record.choices
    assert choices is not None and choices["without"] == ["hysteresis"]


@cache
def changed_cell(**changes: float) -> tuple[TimeSeries, TimeSeries]:
    """A run to learn from and one to judge, of the same cell after something has changed."""
    cell = replace(CELL, **changes)
    return measured(cell, 12, 3000), measured(cell, 14, 3000)


@cache
def renewed(name: str, **changes: float) -> Addition:
    train, validate = changed_cell(**changes)
    return add_effect(fitted().network, name, [train], [SOC], [validate], [SOC])


@pytest.mark.parametrize(
    ("name", "parameter", "changes", "size"),
    [
        pytest.param("hysteresis", "amplitude_V", {"hysteresis_amplitude_V": 0.032}, 0.012, marks=pytest.mark.proof),
        pytest.param(
            "series_resistance",
            "resistance_Ohm",
            {"series_resistance_Ohm": 0.008},
            0.008,
            marks=pytest.mark.proof,
        ),
        pytest.param(
            "temperature_dependence", "activation_K", {"activation_K": 2500.0}, 2500.0, marks=pytest.mark.proof
        ),
        pytest.param(
            "resistance_growth", "growth_per_Ah", {"resistance_growth_per_Ah": 0.04}, 0.04, marks=pytest.mark.proof
        ),
    ],
)
def test_what_a_network_has_is_estimated_again_as_a_difference(
    name: str, parameter: str, changes: dict[str, float], size: float
) -> None:
    made = renewed(name, **changes)
    assert made.parameters[parameter].value == pytest.approx(size, rel=0.1)
    assert made.after.overall_mV < 0.85 * made.before.overall_mV
    network = made.network
    assert network.structure.name == f"bounded+{name}" and network.record.tables is not None
    assert made.remark.endswith("the rest was held to what was known")
    version = version_of(network)
    assert version is not None and version.parent is not None
    # It is a bounded network like any other: another effect can be added to it.
    assert remembers(network)


@pytest.mark.proof
def test_a_contact_that_comes_and_goes_is_taken_out_of_the_runs_and_not_into_the_model() -> None:
    ohm, runs = 0.015, []
    for each in changed_cell():
        bad = np.sin(each.time_s / 230.0) > 0.6
        runs.append(replace(each, voltage_V=each.voltage_V + ohm * bad * each.current_A))
    made = add_effect(fitted().network, "intermittent_contact", [runs[0]], [SOC], [runs[1]], [SOC])
    assert made.parameters["resistance_Ohm"].value == pytest.approx(ohm, rel=0.1)
    assert made.after.overall_mV < 0.6 * made.before.overall_mV
    assert made.remark.startswith("the runs were freed of it")


@cache
def offset_and_worn(ohm: float) -> tuple[TimeSeries, TimeSeries]:
    """What a meter with an offset reads of a cell whose contacts have become worse."""
    learn, judge = (replace(run, voltage_V=run.voltage_V + 0.02 + ohm * run.current_A) for run in changed_cell())
    return learn, judge


@pytest.mark.parametrize("again", ["further", pytest.param("same", marks=pytest.mark.proof)])
def test_runs_are_corrected_once_where_a_second_effect_is_added(again: str) -> None:
    learn, judge = offset_and_worn(0.0)
    first = add_effect(fitted().network, "voltage_offset", [learn], [SOC], [judge], [SOC])
    offset_V = first.parameters["offset_V"].value
    assert offset_V == pytest.approx(0.02, rel=0.1)
    if again == "further":
        learn, judge = offset_and_worn(0.01)
    second = add_effect(first.network, "series_resistance", [learn], [SOC], [judge], [SOC])
    assert second.before.overall_mV == pytest.approx(compare(first.network, [judge], [SOC])["overall"]["rmse_mV"])
    assert second.after.overall_mV == pytest.approx(compare(second.network, [judge], [SOC])["overall"]["rmse_mV"])
    assert second.after.overall_mV < 1.05 * first.after.overall_mV
    # Also on the same runs: what the first was held to would be lost in a fit to these alone.
    assert "held to what was known" in second.remark
    # Runs are known by what was measured.
    version = version_of(second.network)
    assert version is not None and version.runs[0].sha256 == run_sha256(learn)


@pytest.mark.proof
def test_a_model_that_corrects_its_own_runs_is_fitted_to_them_again() -> None:
    first = add_effect(fitted().network, "voltage_offset", [run(2), run(4)], [SOC, SOC], [run(9)], [SOC])
    second = add_effect(first.network, "hysteresis", [run(2), run(4)], [SOC, SOC], [run(9)], [SOC])
    assert "more resolution" in second.remark
    assert second.after.overall_mV == pytest.approx(compare(second.network, [run(9)], [SOC])["overall"]["rmse_mV"])
    assert second.after.overall_mV < 1.05 * first.after.overall_mV


def test_a_temperature_that_stands_still_is_no_sensor_that_a_model_could_correct() -> None:
    learn, judge = (
        replace(run, temperature_degC=np.full(len(run), 25.0), ambient_degC=np.full(len(run), 25.0))
        for run in changed_cell()
    )
    with pytest.raises(ModelError, match="temperature_sensor: the training runs show .* look at the sensor"):
        add_effect(fitted().network, "temperature_sensor", [learn], [SOC], [judge], [SOC])


def test_the_difference_is_said_in_the_unit_of_a_bench() -> None:
    assert re.match(
        r"half the width of the loop: \+1[12]\.\d \+- 0\.\d+ mV against what it was",
        renewed("hysteresis", hysteresis_amplitude_V=0.032).remark,
    )


def test_a_diagnosis_remembers_of_the_new_runs_what_it_would_learn_of_them_now() -> None:
    network = renewed("hysteresis", hysteresis_amplitude_V=0.032).network
    (learned, _), kept = changed_cell(hysteresis_amplitude_V=0.032), known_in(network)
    grid = to_grid(learned, network.structure.dt_s)
    again = memory_of([grid], [SOC], network.cell.capacity_Ah, own_variant(network, [grid]))
    assert kept is not None
    np.testing.assert_allclose(kept.cell.coefficients, again.cell.coefficients, rtol=1e-6, atol=1e-12)


@pytest.mark.proof
def test_a_wrong_effect_moves_the_rest_as_well_and_says_so() -> None:
    made = renewed("hysteresis", capacity_Ah=0.93 * CELL.capacity_Ah)
    assert "more than that has changed" in made.remark
    assert made.after.overall_mV < made.before.overall_mV


@pytest.mark.proof
@pytest.mark.parametrize("learn", [0, 1])
@pytest.mark.parametrize("share", [0.93, 1.05])
def test_charge_is_counted_on_a_new_capacity(share: float, learn: int) -> None:
    """The second run goes 11 points of charge below all that the network was made from."""
    train, validate = changed_cell(capacity_Ah=share * CELL.capacity_Ah)[:: 1 - 2 * learn]
    made = add_effect(fitted().network, "capacity", [train], [SOC], [validate], [SOC])
    assert made.network.cell.capacity_Ah == pytest.approx(share * CELL.capacity_Ah, rel=0.01)
    assert made.after.overall_mV < 0.7 * made.before.overall_mV


@pytest.mark.proof
def test_a_run_that_was_counted_on_from_the_one_before_is_judged_from_where_it_did_begin() -> None:
    cell = replace(CELL, capacity_Ah=0.9 * CELL.capacity_Ah)
    whole = measured(cell, 12, 4500)
    train, validate = part(whole, 0, 3000), part(whole, 3000, 4500)
    left, stated = (SOC + float(whole.current_A[1 : k + 1].sum()) / 3600.0 / CELL.capacity_Ah for k in (2999, 3000))
    true = SOC + (stated - SOC) / 0.9
    assert abs(true - stated) > 0.01
    made = add_effect(fitted().network, "capacity", [train], [SOC], [validate], [left])
    assert "counted on from a training run" in made.remark
    own = add_effect(fitted().network, "capacity", [train], [SOC], [validate], [true])
    assert "counted on" not in own.remark
    assert made.after.overall_mV < 1.5 * own.after.overall_mV
    assert compare(made.network, [validate], [stated])["overall"]["rmse_mV"] > 2.0 * made.after.overall_mV


@pytest.mark.proof
def test_a_resistance_has_grown_by_the_end_of_the_run_that_the_judged_one_was_counted_on_from() -> None:
    whole = measured(replace(CELL, resistance_growth_per_Ah=0.06), 12, 4500)
    train, validate = part(whole, 0, 3000), part(whole, 3000, 4500)
    left = SOC + float(whole.current_A[1:3000].sum()) / 3600.0 / CELL.capacity_Ah
    made = add_effect(fitted().network, "resistance_growth", [train], [SOC], [validate], [left])
    assert made.parameters["growth_per_Ah"].value == pytest.approx(0.06, rel=0.1)
    assert "the runs were freed of it" in made.remark and "had passed before the judged run" in made.remark
    # A thousandth beside the end of the other run nobody knows what has passed.
    alone = add_effect(fitted().network, "resistance_growth", [train], [SOC], [validate], [left + 0.001])
    assert "had passed" not in alone.remark
    assert made.after.overall_mV < 0.5 * alone.after.overall_mV


def test_what_has_grown_goes_by_the_order_in_which_runs_were_given() -> None:
    whole = measured(replace(CELL, resistance_growth_per_Ah=0.06), 12, 4500)
    runs = [part(whole, first, first + 1500) for first in (0, 1500, 3000)]
    soc = [SOC]
    for before in runs[:2]:
        soc.append(soc[-1] + float(before.current_A[1:].sum()) / 3600.0 / CELL.capacity_Ah)
    # The later of the two to learn from is the cooler one.
    runs[1] = replace(runs[1], temperature_degC=runs[1].temperature_degC - 2.0)
    assert run_order(runs[:2]) == [1, 0]
    made = add_effect(fitted().network, "resistance_growth", runs[:2], soc[:2], runs[2:], soc[2:])
    assert "the runs were freed of it" in made.remark
    passed = re.search(r"; (\S+) Ah had passed before the judged run", made.remark)
    assert passed is not None
    assert float(passed[1]) == pytest.approx(np.abs(whole.current_A[:3000]).sum() / 3600.0, rel=0.01)


@pytest.mark.proof
def test_a_resistance_that_has_grown_and_stopped_is_taken_in_by_the_refit() -> None:
    grown = replace(CELL, ohmic_Ohm=1.4 * CELL.ohmic_Ohm)
    train, validate = measured(grown, 12, 3000), measured(grown, 14, 3000)
    made = add_effect(fitted().network, "resistance_growth", [train], [SOC], [validate], [SOC])
    assert "takes it in" in made.remark
    assert made.after.overall_mV < 0.5 * made.before.overall_mV


@pytest.mark.proof
def test_on_its_own_runs_an_effect_gets_more_resolution() -> None:
    made = added("hysteresis", ())
    choices = made.network.record.choices
    assert choices is not None and choices["finer"] == ["hysteresis"]
    assert made.after.overall_mV < 1.02 * made.before.overall_mV
    assert "more resolution" in made.remark


@pytest.mark.proof
def test_what_charge_and_discharge_lose_apart_gets_more_resolution_in_a_bounded_network() -> None:
    made = added("charge_discharge_asymmetry", ())
    choices = made.network.record.choices
    assert choices is not None and choices["finer"] == ["charge_discharge_asymmetry"]
    assert made.network.structure.kernel == "hat"
    assert made.after.overall_mV < 1.05 * made.before.overall_mV


@pytest.mark.proof
def test_an_error_that_rises_on_the_judged_run_is_said() -> None:
    aged = measured(replace(CELL, capacity_Ah=0.9 * CELL.capacity_Ah), 14, 3000)
    other = measured(replace(CELL, capacity_Ah=1.1 * CELL.capacity_Ah), 12, 3000)
    made = add_effect(fitted().network, "capacity", [other], [SOC], [aged], [SOC])
    assert made.after.overall_mV > 1.02 * made.before.overall_mV
    assert "the error rose" in made.remark
    assert "the error rose" not in renewed("capacity", capacity_Ah=0.93 * CELL.capacity_Ah).remark
