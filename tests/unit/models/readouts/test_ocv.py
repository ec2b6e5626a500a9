import json
from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.readouts.ocv import OcvTable, ocv_table, soc_from_rest_voltage
from models.uncertainty.spread import LocalFactor
from tests.unit.models import hand_network

STRUCTURE = Structure(
    1,
    (InputChannel("soc", delay=1), InputChannel("current", order=1), InputChannel("relaxation:300")),
    (PartitionAxis("hysteresis", initial=2), PartitionAxis("temperature", initial=2)),
    hand_network.DT_S,
    kernel="uniform",
)

# Offsets in V of: discharge cold, discharge warm, charge cold, charge warm.
OFFSETS_V = np.array([3.38, 3.40, 3.42, 3.43])


def by_direction(slope_V: float = 0.7, offsets_V: np.ndarray = OFFSETS_V) -> hand_network.LocalModelNetwork:
    """Open-circuit line of its own for each direction and half of the temperature range; hard switches."""
    physical = [[0.9, 0.1 * slope_V, 0.002, 0.001, -0.004, 0.1 * offset] for offset in offsets_V]
    return hand_network.network(STRUCTURE, np.array(physical))


def test_lines_are_read_back_in_volts() -> None:
    table = ocv_table(by_direction(), soc=[0.1, 0.5, 0.9], temperature_degC=[10.0, 35.0])
    line = 0.7 * np.array([0.1, 0.5, 0.9])
    np.testing.assert_allclose(table.voltage_V[0], OFFSETS_V[:2, None] + line, atol=1e-12)
    np.testing.assert_allclose(table.voltage_V[1], OFFSETS_V[2:, None] + line, atol=1e-12)
    np.testing.assert_allclose(table.mean_V[0], 3.40 + line, atol=1e-12)
    assert table.reservations == ()


def test_interpolation_between_points_and_beyond() -> None:
    table = ocv_table(by_direction(), soc=[0.1, 0.9], temperature_degC=[10.0, 35.0])
    assert table.at(0.3, 22.5, 1.0) == pytest.approx(3.425 + 0.21)
    assert table.at(0.3, 22.5, -1.0) == pytest.approx(3.39 + 0.21)
    assert table.at(0.3, 22.5) == pytest.approx(3.4075 + 0.21)
    np.testing.assert_allclose(table.at([0.0, 1.0], -20.0, 1.0), [3.42, 4.12])


def test_document_comes_back_the_same() -> None:
    network = by_direction()
    local = LocalFactor(1e-4 * np.eye(network.theta.size))
    table = ocv_table(network, soc=np.linspace(-0.2, 0.9, 5), local=local)
    again = OcvTable.from_json(json.loads(json.dumps(table.to_json())))
    assert again.reservations == table.reservations != ()
    for name in ("soc", "temperature_degC", "voltage_V", "std_V"):
        np.testing.assert_array_equal(getattr(again, name), getattr(table, name))
    with pytest.raises(ModelError, match="shapes"):
        OcvTable.from_json(table.to_json() | {"soc": [0.0, 1.0]})
    with pytest.raises(ModelError, match="not an open-circuit table"):
        OcvTable.from_json({"kind": "resistance_table", "schema_version": 1})


@pytest.mark.parametrize("order", [0, 1, 2])
def test_band_is_the_spread_over_drawn_parameters(order: int) -> None:
    network = hand_network.everything(order)
    rng = np.random.default_rng(5)
    root = 2e-6 * rng.standard_normal((network.theta.size, network.theta.size))
    axes = {"soc": [0.2, 0.5, 0.8], "temperature_degC": [10.0, 30.0]}
    table = ocv_table(network, **axes, local=LocalFactor(root))
    assert table.std_V is not None
    draws = [
        ocv_table(
            replace(
                network, theta=network.theta + (root @ rng.standard_normal(len(root))).reshape(network.theta.shape)
            ),
            **axes,
        )
        for _ in range(400)
    ]
    spread = np.std([draw.voltage_V for draw in draws], axis=0)
    np.testing.assert_allclose(table.std_V, spread, rtol=0.2)


def test_a_falling_curve_and_a_reach_beyond_the_data_are_reservations() -> None:
    falling = ocv_table(by_direction(slope_V=-0.1), soc=[0.1, 0.5, 1.0], temperature_degC=[30.0])
    texts = "\n".join(falling.reservations)
    assert "after discharge falls by 50.00 mV from SoC 0.500 to 1.000 at 30 degC (2 such step(s))" in texts
    assert "after charge falls" in texts
    assert "soc 0.1..1" in texts


def test_a_loop_the_wrong_way_round_is_a_reservation() -> None:
    table = ocv_table(
        by_direction(offsets_V=np.array([3.4, 3.4, 3.42, 3.37])), soc=[0.1, 0.9], temperature_degC=[10, 35]
    )
    (text,) = table.reservations
    assert "after charge lies 30.00 mV below that after discharge" in text and "35 degC" in text


def test_a_fall_inside_the_band_is_none() -> None:
    network = by_direction(slope_V=-0.001)
    wide = ocv_table(
        network, soc=[0.1, 0.9], temperature_degC=[30.0], local=LocalFactor(1e-2 * np.eye(network.theta.size))
    )
    assert wide.reservations == ()
    assert len(ocv_table(network, soc=[0.1, 0.9], temperature_degC=[30.0]).reservations) == 2


def table_of(soc: np.ndarray, voltage_V: np.ndarray, gap_V: float = 0.0) -> OcvTable:
    branches = np.array([[voltage_V - gap_V / 2], [voltage_V + gap_V / 2]])
    return OcvTable(soc, np.array([25.0]), branches)


def test_rest_voltage_on_a_slope_gives_voltage_over_slope() -> None:
    soc = np.linspace(0.0, 1.0, 51)
    table = table_of(soc, 3.4 + 0.8 * soc)
    mean, std = soc_from_rest_voltage(table, 3.4 + 0.8 * 0.437, 0.002)
    assert mean == pytest.approx(0.437, abs=1e-5)
    assert std == pytest.approx(0.002 / 0.8, rel=1e-3)
    sharp, sharp_std = soc_from_rest_voltage(table, 3.4 + 0.8 * 0.437, 1e-6)
    assert sharp == pytest.approx(0.437, abs=1e-6)
    assert sharp_std == pytest.approx(1e-6 / 0.8, rel=1e-2)


def test_rest_voltage_on_a_plateau_says_how_little_it_knows() -> None:
    soc = np.array([0.0, 0.2, 0.8, 1.0])
    table = table_of(soc, np.array([3.0, 3.3, 3.3, 3.5]))
    mean, std = soc_from_rest_voltage(table, 3.3, 1e-4)
    assert mean == pytest.approx(0.5, abs=0.01)
    assert std == pytest.approx(0.6 / np.sqrt(12.0), rel=0.02)


def test_direction_before_the_rest_chooses_the_branch_and_sharpens() -> None:
    soc = np.linspace(0.0, 1.0, 51)
    table = table_of(soc, 3.4 + 0.8 * soc, gap_V=0.040)
    voltage = 3.4 + 0.8 * 0.5 + 0.020
    after_charge = soc_from_rest_voltage(table, voltage, 1e-3, direction=1.0)
    unknown = soc_from_rest_voltage(table, voltage, 1e-3)
    assert after_charge[0] == pytest.approx(0.5, abs=1e-4)
    assert after_charge[1] == pytest.approx(1e-3 / 0.8, rel=1e-2)
    assert unknown[0] == pytest.approx(0.525, abs=1e-3)
    assert unknown[1] == pytest.approx(np.hypot(0.040 / np.sqrt(12.0), 1e-3) / 0.8, rel=0.02)


def test_band_of_the_table_widens_the_answer() -> None:
    soc = np.linspace(0.0, 1.0, 51)
    table = replace(table_of(soc, 3.4 + 0.8 * soc), std_V=np.full((2, 1, 51), 0.003))
    _, std = soc_from_rest_voltage(table, 3.8, 0.004, direction=-1.0)
    assert std == pytest.approx(0.005 / 0.8, rel=1e-2)


@pytest.mark.parametrize(
    ("voltage_V", "std_V", "says"), [(4.3, 0.001, "outside"), (3.8, 0.0, "positive"), (np.nan, 0.01, "finite")]
)
def test_impossible_rest_voltages_are_refused(voltage_V: float, std_V: float, says: str) -> None:
    soc = np.linspace(0.0, 1.0, 51)
    with pytest.raises(ModelError, match=says):
        soc_from_rest_voltage(table_of(soc, 3.4 + 0.8 * soc), voltage_V, std_V)


def test_a_voltage_just_outside_is_the_end_of_the_table() -> None:
    soc = np.linspace(0.0, 1.0, 51)
    mean, std = soc_from_rest_voltage(table_of(soc, 3.4 + 0.8 * soc), 4.202, 0.001)
    assert 0.998 < mean <= 1.0
    assert std < 0.00125
