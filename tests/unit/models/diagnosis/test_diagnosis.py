"""What a diagnosis is held against: training runs, the memory of them, or the network's own voltage."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.diagnosis.diagnosis import as_simulated, diagnose, network_memory, own_activation_K
from models.diagnosis.reference.record import Record, make_record
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from tests.unit.models.diagnosis.hand_reference import SOC, steps_A, true_run
from tests.unit.models.hand_network import network


def plain_network() -> LocalModelNetwork:
    structure = Structure(0, (InputChannel("soc", delay=1), InputChannel("current")), (PartitionAxis("soc"),), 1.0)
    return network(structure, np.array([[0.7, 0.02, 3.4]]))


def series(n: int = 1200, noise_V: float = 1e-3, added_V: float = 0.0) -> TimeSeries:
    run = true_run(steps_A(n), noise_V=noise_V, added_V=added_V)
    return TimeSeries(run.time_s, run.current_A, run.voltage_V, np.full(n, np.nan), name="steps")


@pytest.fixture(scope="module")
def record() -> Record:
    return make_record(plain_network(), [series(added_V=0.008)], [SOC])


def test_calls_that_cannot_be_answered_are_refused() -> None:
    model, run = plain_network(), series(100)
    with pytest.raises(ModelError, match="no run was given"):
        diagnose(model, [], [])
    with pytest.raises(ModelError, match="mode 'repair' is unknown; use change or structure"):
        diagnose(model, [run], [SOC], mode="repair")  # pyright: ignore[reportArgumentType]
    for train_soc in (None, [SOC, SOC]):
        with pytest.raises(ModelError, match="SoC at the start"):
            diagnose(model, [run], [SOC], train=[run], train_soc=train_soc)


def test_a_record_given_twice_is_no_second_witness() -> None:
    model, run = plain_network(), series()
    other = replace(run, voltage_V=run.voltage_V + 1e-3)
    with pytest.raises(ModelError, match=r"run 3 \(again\) is the same record as run 1 \(steps\).*leave one"):
        diagnose(model, [run, other, replace(run, name="again")], [SOC, SOC, SOC])


def test_without_training_runs_the_cell_was_as_the_network_has_it(record: Record) -> None:
    simulated, soc = as_simulated(record)
    run = true_run(steps_A(1200))
    assert soc == [SOC]
    # The network takes the state of charge of the sample before.
    np.testing.assert_allclose(simulated[0].voltage_V, run.voltage_V, atol=4e-4)


def test_trained_is_what_the_network_was_made_from_and_not_what_the_runs_go_through(record: Record) -> None:
    """Beyond it the network goes on in a line: that is no capacity."""
    made_from = (SOC - 0.01, SOC + 0.02)
    document = plain_network().to_json()
    document["record"] = {**document["record"], "domain": {"soc": list(made_from)}}
    found = network_memory(LocalModelNetwork.from_json(document), record).cell
    assert found.soc_range == made_from


def test_the_networks_voltage_is_right_to_the_noise_and_to_its_own_training_error(record: Record) -> None:
    floor = (1e-3 * (record.noise_floor_mV or 0.0)) ** 2
    assert floor == pytest.approx(1e-6, rel=0.2)
    found = network_memory(plain_network(), record).elsewhere
    assert (found.noise_V2, found.own_V2) == (pytest.approx(floor), 0.0)
    document = plain_network().to_json()
    document["record"] = {**document["record"], "train": {"rmse_mV": 5.0}}
    found = network_memory(LocalModelNetwork.from_json(document), record).elsewhere
    assert found.noise_V2 + found.own_V2 == pytest.approx(25e-6)


def test_a_structures_activation_is_the_largest_of_its_signals() -> None:
    axes = (PartitionAxis("soc"),)
    plain = Structure(0, (InputChannel("soc", delay=1), InputChannel("current")), axes, 1.0)
    assert own_activation_K(plain) == 0.0
    warm = replace(plain, inputs=(*plain.inputs, InputChannel("scaled_current:1500"), InputChannel("low_pass:30/2500")))
    assert own_activation_K(warm) == 2500.0


def test_a_resistance_that_is_new_is_named_with_the_network_alone() -> None:
    run = true_run(steps_A(3000), noise_V=5e-4, added_V=0.006 * steps_A(3000))
    after = TimeSeries(run.time_s, run.current_A, run.voltage_V, np.full(3000, np.nan))
    answer = diagnose(plain_network(), [after], [SOC], mode="change")
    assert (answer.mode, answer.findings[0].effect) == ("change", "series_resistance")
    assert answer.findings[0].parameters["resistance_Ohm"].value == pytest.approx(0.006, rel=0.1)
    assert any("without the training runs" in remark for remark in answer.remarks)
