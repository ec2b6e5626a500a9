"""What is said of runs beyond the training runs, by hand."""

from dataclasses import replace

import numpy as np

from models.diagnosis.answer.beyond import beyond_remarks
from models.diagnosis.reference.record import Record
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from tests.unit.models.diagnosis.hand_reference import SOC, steps_A, true_run
from tests.unit.models.hand_network import network


def trained(**domain: tuple[float, float]) -> LocalModelNetwork:
    structure = Structure(0, (InputChannel("soc", delay=1), InputChannel("current")), (PartitionAxis("soc"),), 1.0)
    document = network(structure, np.array([[0.7, 0.02, 3.4]])).to_json()
    document["record"] = {**document["record"], "domain": {name: list(ends) for name, ends in domain.items()}}
    return LocalModelNetwork.from_json(document)


def looked_at(degC: float, ten_A: int = 0) -> Record:
    run = true_run(steps_A(1000))
    current_A = run.current_A.copy()
    current_A[:ten_A] = 10.0
    run = replace(run, temperature_degC=np.full(len(run), degC), current_A=current_A)
    return Record([run], [SOC], [np.zeros(len(run))])


def test_nothing_is_said_of_what_was_trained() -> None:
    model = trained(soc=(0.0, 1.0), current_A=(-20.0, 20.0), temperature_degC=(20.0, 30.0))
    assert beyond_remarks(model, looked_at(25.0), "change") == []
    assert beyond_remarks(trained(), looked_at(-5.0), "structure") == []


def test_temperatures_and_currents_that_no_run_had_are_told_in_both_modes() -> None:
    model = trained(current_A=(-5.0, 5.0), temperature_degC=(22.0, 29.0))
    for mode in ("change", "structure"):
        (warmth,) = beyond_remarks(model, looked_at(-5.0), mode)
        assert "100 % of the samples are at temperatures (-5 to -5 degC) that no training run had (22 to 29" in warmth
        (current,) = beyond_remarks(model, looked_at(25.0, ten_A=100), mode)
        assert "10 % of the samples are at currents (10 to 10 A) that no training run had (-5 to 5 A)" in current
    assert beyond_remarks(model, looked_at(25.0, ten_A=10), "change") == []


def test_states_of_charge_beyond_are_told_where_they_are_weighed() -> None:
    model = trained(soc=(SOC + 0.1, SOC + 0.3))
    assert beyond_remarks(model, looked_at(25.0), "change") == []
    (charge,) = beyond_remarks(model, looked_at(25.0), "structure")
    assert "states of charge" in charge and "no training run had" in charge
