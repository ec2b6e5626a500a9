"""The measuring layer."""

import numpy as np
import pytest

from simulators.catalogue import CELLS
from simulators.cell import Cell
from simulators.sensors import Measurement, SensorParameters, Sensors


def record(seed: int, parameters: SensorParameters, count: int = 2000) -> list[Measurement]:
    truth = Cell(CELLS["nmc"].parameters).step(0.0, 0.0)
    sensors = Sensors(parameters, np.random.default_rng(seed))
    return [sensors.measure(truth, 1.0, 25.0) for _ in range(count)]


def test_noise_is_seeded_to_the_bit() -> None:
    assert record(7, SensorParameters()) == record(7, SensorParameters())
    assert record(7, SensorParameters()) != record(8, SensorParameters())


def test_noise_has_the_size_that_was_set() -> None:
    parameters = SensorParameters(voltage_noise_V=2e-3, current_noise_A=0.01, temperature_noise_K=0.1)
    seen = np.array(record(1, parameters, 20_000))
    assert seen.std(axis=0) == pytest.approx([2e-3, 0.01, 0.1, 0.1], rel=0.03)
    assert seen[:, 1].mean() == pytest.approx(1.0, abs=5e-4)


def test_values_lie_on_the_converters_steps() -> None:
    parameters = SensorParameters(voltage_resolution_V=5e-3, temperature_resolution_K=0.5)
    for seen in record(1, parameters, 50):
        assert seen.voltage_V / 5e-3 == pytest.approx(round(seen.voltage_V / 5e-3), abs=1e-9)
        assert seen.temperature_degC / 0.5 == pytest.approx(round(seen.temperature_degC / 0.5), abs=1e-9)


def test_one_noise_setting_leaves_the_other_channels_noise_alone() -> None:
    loud = record(3, SensorParameters(voltage_noise_V=0.0))
    quiet = record(3, SensorParameters())
    assert [m.current_A for m in loud] == [m.current_A for m in quiet]


def test_temperature_gain_acts_against_ambient() -> None:
    cell = Cell(CELLS["nmc"].parameters, soc=0.1)
    truth = cell.step(5.0, 600.0)
    quiet = SensorParameters(temperature_noise_K=0.0, temperature_resolution_K=0.0, temperature_gain=0.5)
    seen = Sensors(quiet, np.random.default_rng(0)).measure(truth, 5.0, 25.0)
    assert truth.temperature_degC > 30.0
    assert seen.temperature_degC == pytest.approx(25.0 + 0.5 * (truth.temperature_degC - 25.0), abs=1e-9)


def test_negative_noise_is_refused() -> None:
    with pytest.raises(ValueError, match="voltage_noise_V is -1"):
        SensorParameters(voltage_noise_V=-1.0)
