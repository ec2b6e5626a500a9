"""Corrections that a model was made with hold for every run that it is given, whole or sample by sample."""

import math
from dataclasses import replace

import numpy as np
import pytest

from models.comparison.figures import compare
from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.effects import effect
from models.effects.input_correction import (
    Correction,
    LiveCorrection,
    as_read,
    check_correction,
    corrections_of,
)
from models.effects.reading import Reading
from models.network.model_record import ModelRecord
from models.network.signals import soc_by_counting
from models.observer import FuzzyObserver
from models.observer.observation import observe
from models.pipeline.addition import add_effect
from models.pipeline.fit import fit_network
from tests.unit.models.diagnosis.cells import SOC, bare, measured
from tests.unit.models.diagnosis.structure.test_structure import BARE

CELL = bare()
OFFSET_A = 0.04


def entry(effect: str, **values: float) -> dict:
    return {"effect": effect, "correction": True, "parameters": {name: {"value": v} for name, v in values.items()}}


ALL = [
    entry("current_offset", offset_A=0.1),
    entry("self_discharge", leakage_A=0.01),
    entry("voltage_offset", offset_V=0.005),
    entry("temperature_sensor", gain=1.2, offset_K=0.7),
]


AMBIENT_DEGC = np.random.default_rng(5).normal(22.0, 0.1, 60)


def run_of(n: int = 60, dt_s: float = 0.5) -> TimeSeries:
    rng = np.random.default_rng(4)
    voltage = rng.normal(3.7, 0.1, n)
    voltage[20] = np.nan
    columns = (rng.normal(0.0, 2.0, n), voltage, rng.normal(25.0, 1.0, n), AMBIENT_DEGC)
    return TimeSeries(dt_s * np.arange(n), *columns)


def test_each_sensor_reads_what_is_true_afterwards() -> None:
    true = run_of()
    rise_K = 1.2 * (true.temperature_degC - AMBIENT_DEGC)
    wrong = replace(
        true,
        current_A=true.current_A + 0.11,
        voltage_V=true.voltage_V + 0.005,
        temperature_degC=AMBIENT_DEGC + rise_K + 0.7,
    )
    read = as_read(ModelRecord(effects=tuple(ALL)), wrong)
    for name in ("current_A", "voltage_V", "temperature_degC"):
        np.testing.assert_allclose(getattr(read, name), getattr(true, name), rtol=1e-12)


def test_an_effect_in_the_structure_corrects_nothing() -> None:
    run = run_of()
    record = ModelRecord(effects=({"effect": "hysteresis", "correction": False, "parameters": {}},))
    assert as_read(record, run) is run
    assert as_read(ModelRecord(), run) is run


@pytest.mark.parametrize("delay_s", [0.0, 0.5, 0.8, 1.7, -0.3, -1.0])
def test_live_gives_the_same_samples_as_a_whole_run(delay_s: float) -> None:
    run, record = run_of(), ModelRecord(effects=(*ALL, entry("dead_time", delay_s=delay_s)))
    # Over a gap a whole run interpolates further than a live one can.
    run = replace(run, voltage_V=np.where(np.isnan(run.voltage_V), 3.7, run.voltage_V))
    whole, live = as_read(record, run), LiveCorrection(corrections_of(record), 0.5)
    samples = [
        live.step(Reading(*row))
        for row in zip(run.current_A, run.voltage_V, run.temperature_degC, AMBIENT_DEGC, strict=True)
    ]
    late = max(math.ceil(delay_s / 0.5), 0)
    assert samples[:late] == [None] * late
    for k, sample in enumerate(samples[late:]):
        assert sample is not None
        expected = (whole.current_A[k], whole.voltage_V[k], whole.temperature_degC[k])
        np.testing.assert_allclose(sample[:3], expected, rtol=1e-12)


def test_a_missing_voltage_stays_missing() -> None:
    live = LiveCorrection((Correction("dead_time", {"delay_s": 0.5}),), 0.5)
    assert live.step(Reading(1.0, math.nan, 25.0, math.nan)) is None
    sample = live.step(Reading(1.0, 3.7, 25.0, math.nan))
    assert sample is not None and math.isnan(sample.voltage_V)


@pytest.mark.parametrize(
    "effects",
    [
        [{"effect": "gremlins", "correction": True, "parameters": {}}],
        [{"effect": "current_offset", "correction": True, "parameters": {}}],
        [entry("current_offset", offset_A=math.nan)],
        [entry("temperature_sensor", gain=0.0, offset_K=0.0)],
        ["current_offset"],
    ],
)
def test_a_damaged_record_is_refused(effects: list) -> None:
    with pytest.raises(ModelError, match="correction"):
        as_read(ModelRecord(effects=tuple(effects)), run_of())


@pytest.mark.parametrize("gain", [-0.3, 0.1, math.nan])
def test_what_a_model_could_not_be_read_with_is_refused(gain: float) -> None:
    sensor, values = effect("temperature_sensor"), {"offset_K": 1.5, "gain": gain}
    with pytest.raises(ModelError, match=rf"temperature_sensor: .* offset_K = 1.5 K, gain = {gain:g}, .* the sensor"):
        check_correction(sensor, values)
    check_correction(sensor, values | {"gain": 0.5})
    check_correction(effect("hysteresis"), {"amplitude_V": math.nan})


def test_a_gain_against_ambient_needs_ambient() -> None:
    with pytest.raises(ModelError, match="ambient"):
        as_read(ModelRecord(effects=tuple(ALL)), replace(run_of(), ambient_degC=None))


@pytest.mark.proof
def test_a_model_with_a_sensors_offset_compares_and_observes_with_the_true_current() -> None:
    train, run = measured(CELL, 1), measured(CELL, 2)
    fit = fit_network([train], capacity_Ah=CELL.capacity_Ah, structure=BARE, initial_soc=[SOC], dt_s=1.0)
    network = fit.network
    wrong = [replace(each, current_A=each.current_A + OFFSET_A) for each in (train, run)]
    added = add_effect(network, "current_offset", [wrong[0]], [SOC], [wrong[1]], [SOC])
    found = compare(added.network, [wrong[1]], [SOC])
    # The error that `compare` tells is the one that the addition was judged by.
    assert found["overall"]["rmse_mV"] == pytest.approx(added.after.overall_mV, rel=1e-9)
    assert [each["effect"] for each in found["corrections"]] == ["current_offset"]
    before = compare(network, [wrong[1]], [SOC])
    assert found["overall"]["rmse_mV"] < 0.5 * before["overall"]["rmse_mV"]
    # A second version begins with what the first has put right.
    again = add_effect(added.network, "voltage_offset", [wrong[0]], [SOC], [wrong[1]], [SOC])
    assert again.before.overall_mV == pytest.approx(added.after.overall_mV, rel=1e-9)
    assert again.after.overall_mV < 1.1 * added.after.overall_mV
    # The observer's state of charge does not drift away with the offset.
    charge_Ah = np.concatenate([[0.0], np.cumsum(run.current_A[1:])]) / 3600.0
    judged = replace(wrong[1], soc_ref=soc_by_counting(charge_Ah, SOC, CELL.capacity_Ah, 1.0))
    ends = []
    for model in (network, added.network):
        settings = replace(FuzzyObserver(model).settings, current_offset_std_C=0.0)
        observed = observe(FuzzyObserver(model, settings), judged, SOC, 1e-4)
        ends.append(abs(observed.figures["soc_end_error"] or 0.0))
    assert ends[1] < 0.3 * ends[0]
