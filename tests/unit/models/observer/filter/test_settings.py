"""What the observer assumes, and what of it is refused."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.observer.filter.settings import ObserverSettings, default_settings, error_levels
from tests.unit.models.hand_network import network


def plain_network(**record: object) -> LocalModelNetwork:
    structure = Structure(0, (InputChannel("soc", delay=1), InputChannel("current")), (PartitionAxis("soc"),), 1.0)
    document = network(structure, np.array([[0.7, 0.02, 3.4]])).to_json()
    document["record"] = {**document["record"], **record}
    return LocalModelNetwork.from_json(document)


def test_settings_survive_as_json() -> None:
    settings = replace(ObserverSettings(), voltage_std_V=0.007, gain="steady", capacity_std=0.0)
    assert ObserverSettings.from_json(settings.to_json()) == settings


@pytest.mark.parametrize(
    "changes",
    [
        {"voltage_std_V": 0.0},
        {"voltage_std_V": -0.1},
        {"soc_std_per_sqrt_s": 0.0},
        {"quick_error_time_s": 0},
        {"band_factor": float("nan")},
        {"loop_std": float("inf")},
        {"capacity_std": -1e-9},
        {"gain": "best"},
        {"gain": 1.0},
        {"voltage_std_V": "much"},
        {"voltage_std_V": None},
        {"colour": 1.0},
    ],
)
def test_what_no_filter_can_work_with_is_refused(changes: dict) -> None:
    with pytest.raises(ModelError, match="observer settings"):
        ObserverSettings.from_json(ObserverSettings().to_json() | changes)


@pytest.mark.parametrize("name", ["output_std_V", "current_offset_std_C", "capacity_std", "loop_std", "judged_noise_V"])
def test_what_may_be_left_out_is_zero(name: str) -> None:
    assert getattr(ObserverSettings.from_json({name: 0}), name) == 0.0


def test_settings_that_were_tuned_with_a_model_are_its_own() -> None:
    tuned = replace(ObserverSettings(), voltage_std_V=0.0042)
    assert default_settings(plain_network(observer=tuned.to_json())) == tuned
    with pytest.raises(ModelError, match="voltage_std_V"):
        default_settings(plain_network(observer={"voltage_std_V": -1.0}))


@pytest.mark.parametrize(
    ("record", "rmse_V"),
    [({"train": {"rmse_mV": 4.0}}, 0.004), ({"train": {"rmse_mV": 0.2}}, 0.001), ({}, 0.010)],
)
def test_a_model_without_uncertainty_is_trusted_to_its_training_error(record: dict, rmse_V: float) -> None:
    found = default_settings(plain_network(**record))
    assert found.voltage_std_V == pytest.approx(rmse_V)
    assert found.quick_error_std_V == pytest.approx(0.5 * rmse_V)
    assert found.slow_error_std_V == pytest.approx(rmse_V)


def test_of_a_model_that_says_nothing_the_error_is_the_same_everywhere() -> None:
    assert error_levels(plain_network()).tolist() == [1.0]
