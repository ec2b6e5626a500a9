"""The request for the profile that settles which of two effects it is."""

import numpy as np
import pytest

from models.design.request import read_request
from models.diagnosis.answer.next_experiment import discriminating_request
from tests.unit.models.diagnosis.hand_reference import reference
from tests.unit.models.hand_network import CAPACITY_AH

VOLTAGE_V = np.array([3.5, 3.9, 3.6])


def test_it_stays_inside_what_the_runs_kept() -> None:
    found = discriminating_request(reference(), ("charge_transfer", "series_resistance"), VOLTAGE_V, 0.4)
    assert found["limits"]["current_A"] == [-4.0, 4.0]
    assert found["limits"]["soc"] == [0.1, 0.9]
    assert found["limits"]["voltage_V"] == pytest.approx([3.48, 3.92])
    assert "temperature_degC" not in found["limits"]
    assert (found["capacity_Ah"], found["dt_s"], found["initial_soc"]) == (CAPACITY_AH, 1.0, 0.4)


def test_a_known_temperature_limits_it_too() -> None:
    warm = reference(with_temperature=True)
    found = discriminating_request(warm, ("charge_transfer", "series_resistance"), VOLTAGE_V, 0.4)
    assert found["limits"]["temperature_degC"] == [15.0, 35.0]


@pytest.mark.parametrize(
    ("rivals", "hours"),
    [
        (("charge_transfer", "series_resistance"), 4.0),
        (("current_offset", "self_discharge"), 10.0),
        (("series_resistance", "hysteresis"), 10.0),  # one slow one is enough
    ],
)
def test_what_shows_over_hours_gets_hours(rivals: tuple[str, str], hours: float) -> None:
    found = discriminating_request(reference(), rivals, VOLTAGE_V, 0.4)
    assert found["duration_s"] == 3600.0 * hours
    assert found["rivals"] == list(rivals)
    assert found["criterion"] == "discriminate"


def test_the_design_takes_it() -> None:
    found = discriminating_request(reference(), ("current_offset", "self_discharge"), VOLTAGE_V, 0.4)
    request = read_request(found)
    assert request.criterion == "discriminate" and tuple(request.rivals) == ("current_offset", "self_discharge")
