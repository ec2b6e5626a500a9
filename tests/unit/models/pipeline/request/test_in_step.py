"""A log whose voltage comes late makes the model that it would have made in time, and every further log is read so."""

from __future__ import annotations

import numpy as np
import pytest

from models.comparison import compare
from models.data.timeseries import TimeSeries
from models.effects import effect
from models.effects.input_correction import corrected
from models.pipeline.addition import add_effect
from models.pipeline.fit import fit_network
from models.pipeline.request import FitRequest, in_step
from tests.unit.models.diagnosis.cells import SOC
from tests.unit.models.pipeline.bounded_cell import CELL, fitted, run


def late(on_time: TimeSeries, delay_s: float) -> TimeSeries:
    return corrected(on_time, effect("dead_time"), {"delay_s": -delay_s})


def test_a_log_in_step_is_left() -> None:
    request = FitRequest(train=[run(2), run(4)], capacity_Ah=CELL.capacity_Ah, initial_soc=[SOC, SOC])
    assert in_step(request).request is request


def test_runs_that_an_earlier_model_reads_are_left() -> None:
    request = FitRequest(train=[late(run(2), 2.0)], capacity_Ah=CELL.capacity_Ah, initial_soc=[SOC], in_step=True)
    assert in_step(request).request is request


@pytest.mark.proof
def test_an_effect_that_is_added_keeps_how_runs_are_read() -> None:
    asked = {"capacity_Ah": CELL.capacity_Ah, "initial_soc": [SOC, SOC], "dt_s": 1.0}
    train = [late(run(2), 2.0), late(run(4), 2.0)]
    parent = fit_network(train, structure="bounded", without=("hysteresis",), **asked).network
    made = add_effect(parent, "hysteresis", train, [SOC, SOC], [late(run(9), 2.0)], [SOC])
    assert [each["effect"] for each in made.network.record.effects] == ["dead_time", "hysteresis"]
    assert made.after.overall_mV < 0.5 * made.before.overall_mV


@pytest.mark.parametrize("delay_s", [2.0, pytest.param(-1.0, marks=pytest.mark.proof)])
def test_a_late_voltage_is_put_in_step_and_said(delay_s: float) -> None:
    asked = {"capacity_Ah": CELL.capacity_Ah, "initial_soc": [SOC, SOC], "dt_s": 1.0}
    train = [late(run(2), delay_s), late(run(4), delay_s)]
    judged = late(run(9), delay_s)
    made = fit_network(train, structure="bounded", validate=[judged], validate_soc=[SOC], **asked)
    (entry,) = made.network.record.effects
    assert entry["effect"] == "dead_time" and entry["correction"]
    assert entry["parameters"]["delay_s"]["value"] == delay_s
    assert entry["error_after_mV"] < entry["error_before_mV"]
    usability = made.network.record.usability
    assert usability is not None and any("put in step" in reason for reason in usability["reasons"])
    assert made.validation is not None
    on_time = fitted().validation
    assert on_time is not None
    assert made.validation["rmse_mV"] == pytest.approx(on_time["rmse_mV"], rel=0.1)
    assert compare(made.network, [judged], [SOC])["overall"]["rmse_mV"] == pytest.approx(
        made.validation["rmse_mV"], rel=1e-9
    )


def test_a_voltage_a_sample_late_is_no_wrong_sign() -> None:
    rng = np.random.default_rng(5)
    current_A = rng.choice([-1.0, 1.0], 3000)
    soc = 0.5 + np.concatenate([[0.0], np.cumsum(current_A[1:])]) / 3600.0 / 2.0
    voltage_V = 3.2 + soc + 0.05 * current_A + rng.normal(0.0, 1e-4, 3000)
    time_s = np.arange(3000.0)
    measured = TimeSeries(time_s, current_A, np.roll(voltage_V, 1), np.full(3000, 25.0))
    asked = FitRequest(train=[measured], capacity_Ah=2.0, initial_soc=[0.5])
    (entry,) = in_step(asked).effects
    assert entry["parameters"]["delay_s"]["value"] == 1.0
