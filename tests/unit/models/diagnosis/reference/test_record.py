"""Runs to be diagnosed with the network's error on them."""

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.diagnosis.reference.record import Record, make_record
from models.network.structure import InputChannel, PartitionAxis, Structure
from tests.unit.models.diagnosis.cells import simple_network
from tests.unit.models.diagnosis.hand_reference import steps_A, true_run
from tests.unit.models.hand_network import CAPACITY_AH, grid_run, network


def series(n: int = 400, error_V: float = 0.0, temperature_degC: float = 25.0) -> TimeSeries:
    """What a cell of 3.4 V + 0.7 V soc + 0.02 Ohm gives."""
    run = true_run(steps_A(n), soc=0.6, added_V=error_V)
    return TimeSeries(run.time_s, run.current_A, run.voltage_V, np.full(n, temperature_degC))


def plain_network(*inputs: str):  # noqa: ANN201
    """3.4 V + 0.7 V soc(k-1) + 0.02 Ohm current, and no more of other inputs."""
    channels = (InputChannel("soc", delay=1), InputChannel("current"), *(InputChannel(name) for name in inputs))
    structure = Structure(0, channels, (PartitionAxis("soc"),), 1.0)
    return network(structure, np.array([[0.7, 0.02, *[0.0] * len(inputs), 3.4]]))


def test_the_error_is_measured_minus_simulated() -> None:
    record = make_record(plain_network(), [series(error_V=0.012), series(error_V=-0.012)], [0.6, 0.6])
    first, second = (np.nanmean(each) for each in record.error_V)
    # The network takes the state of charge of the sample before: 0.3 mV at most.
    assert first == pytest.approx(0.012, abs=3e-4) and second == pytest.approx(-0.012, abs=3e-4)
    assert record.rms_mV == pytest.approx(12.0, abs=0.3)
    assert record.soc == [0.6, 0.6]


def test_samples_without_a_voltage_do_not_count() -> None:
    run = grid_run(np.zeros(4), 25.0)
    record = Record([run], [0.5], [np.array([3e-3, np.nan, -4e-3, np.nan])])
    assert record.rms_mV == pytest.approx(1e3 * np.sqrt((9e-6 + 16e-6) / 2.0))


def test_what_is_explained_is_taken_off_each_run() -> None:
    run = grid_run(np.zeros(2), 25.0)
    record = Record([run, run], [0.5, 0.5], [np.array([3e-3, 3e-3]), np.array([5e-3, 1e-3])])
    left = record.less([np.array([3e-3, 1e-3]), np.array([5e-3, 1e-3])])
    assert left.rms_mV == pytest.approx(1.0)
    assert record.rms_mV > left.rms_mV and left.runs is record.runs
    with pytest.raises(ValueError, match="zip"):
        record.less([np.zeros(2)])


def test_the_noise_floor_is_the_middle_one_of_the_runs_that_can_tell() -> None:
    noisy = [true_run(np.zeros(3000), noise_V=1e-3 * k, seed=k) for k in (1, 2, 9)]
    short = true_run(np.zeros(10))
    record = Record([*noisy, short], [0.5] * 4, [])
    assert record.noise_floor_mV == pytest.approx(2.0, rel=0.1)
    assert Record([short], [0.5], []).noise_floor_mV is None


def test_runs_that_the_model_says_nothing_of_are_refused() -> None:
    needs_temperature = plain_network("temperature")
    blind = series()
    blind = TimeSeries(blind.time_s, blind.current_A, np.full(len(blind), np.nan), blind.temperature_degC)
    with pytest.raises(ModelError, match="no voltage on these runs"):
        make_record(needs_temperature, [blind], [0.6])


def test_a_run_is_put_on_the_networks_grid() -> None:
    run = series(401)
    twice = TimeSeries(run.time_s * 0.5, run.current_A, run.voltage_V, run.temperature_degC)
    record = make_record(simple_network(CAPACITY_AH), [twice], [0.6])
    assert len(record.runs[0]) == len(record.error_V[0]) == 201
