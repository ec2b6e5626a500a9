import json
from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.network.free_run import free_run_V
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.readouts.resistance import ResistanceTable, resistance_table
from models.uncertainty.spread import LocalFactor
from tests.unit.models import hand_network

STRUCTURE = Structure(
    2,
    (InputChannel("soc", delay=1), InputChannel("current", order=2), InputChannel("low_pass:30")),
    (PartitionAxis("hysteresis", initial=2), PartitionAxis("temperature", initial=2)),
    hand_network.DT_S,
    kernel="uniform",
)

# Ohm of: discharge cold, discharge warm, charge cold, charge warm.
OHM = np.array([0.080, 0.040, 0.100, 0.050])


def by_direction(ohm: np.ndarray = OHM) -> hand_network.LocalModelNetwork:
    """Static resistance shared between three taps of the current and a low-pass; hysteresis of 30 mV besides."""
    physical = []
    for i, value in enumerate(ohm):
        a_1, a_2 = 1.1, -0.2
        gain = 1.0 - a_1 - a_2
        offset = 3.4 + (0.03 if i >= 2 else 0.0)
        shares = value * np.array([0.5, 0.1, -0.05, 0.45])
        physical.append([a_1, a_2, 0.6 * gain, *(gain * shares), offset * gain])
    return hand_network.network(STRUCTURE, np.array(physical))


def test_gains_are_read_back_in_ohm() -> None:
    table = resistance_table(by_direction(), soc=[0.2, 0.8], current_A=[-6.0, -1.0, 2.0], temperature_degC=[10.0, 35.0])
    for c, direction in enumerate((0, 0, 2)):
        for t in (0, 1):
            np.testing.assert_allclose(table.resistance_Ohm[c, t], OHM[direction + t], rtol=1e-10)
    assert table.reservations == ()


def test_resistance_follows_the_current_where_the_network_does() -> None:
    network = hand_network.everything(1)
    table = resistance_table(network, soc=[0.5], current_A=[-6.0, -3.0, 1.0, 4.0], temperature_degC=[20.0])
    n = 6000
    for c, current_A in enumerate(table.current_A):
        loaded = hand_network.grid_run(np.full(n, current_A), 20.0, counted=False)
        direction = np.full(n, np.sign(current_A) * 0.5)  # above rest, for as long as hysteresis needs
        direction[3000:] = 0.0
        rested = hand_network.grid_run(direction, 20.0, counted=False)
        difference_V = free_run_V(network, loaded, 0.5)[-1] - free_run_V(network, rested, 0.5)[-1]
        assert table.resistance_Ohm[c, 0, 0] == pytest.approx(difference_V / current_A, abs=1e-5)
    assert np.ptp(table.resistance_Ohm) > 1e-3


def test_interpolation_stays_in_its_direction() -> None:
    axes = {"soc": [0.2, 0.8], "current_A": [-6.0, -1.0, 2.0], "temperature_degC": [10.0, 35.0]}
    table = resistance_table(by_direction(), **axes)
    found = table.at(0.5, np.array([-9.0, -0.1, 0.1, 9.0]), 10.0)
    np.testing.assert_allclose(found, [0.080, 0.080, 0.100, 0.100], rtol=1e-10)
    assert table.at(0.5, -3.0, 22.5) == pytest.approx(0.060)
    assert table.at(-1.0, -3.0, 90.0) == pytest.approx(0.040)


def test_document_comes_back_the_same_with_points_that_do_not_settle() -> None:
    network = by_direction()
    theta = network.theta.copy()
    theta[3, 0] = 1.3
    local = LocalFactor(1e-4 * np.eye(theta.size))
    table = resistance_table(replace(network, theta=theta), temperature_degC=[10.0, 35.0], local=local)
    assert any("does not settle" in text for text in table.reservations)
    again = ResistanceTable.from_json(json.loads(json.dumps(table.to_json(), allow_nan=False)))
    for name in ("soc", "temperature_degC", "current_A", "resistance_Ohm", "std_Ohm"):
        np.testing.assert_array_equal(getattr(again, name), getattr(table, name))
    assert again.reservations == table.reservations
    with pytest.raises(ModelError, match="damaged"):
        ResistanceTable.from_json(table.to_json() | {"soc": [0.5]})
    with pytest.raises(ModelError, match="not a resistance table"):
        ResistanceTable.from_json(table.to_json() | {"schema_version": 2})


def test_band_in_closed_form() -> None:
    """R = b v / i for one tap without past outputs; its standard deviation is that of b times v / i."""
    structure = Structure(0, (InputChannel("current"),), (PartitionAxis("soc"),), hand_network.DT_S)
    network = hand_network.network(structure, np.array([[0.05, 3.5]]))
    table = resistance_table(network, soc=[0.3, 0.6], local=LocalFactor(np.diag([0.01, 0.3])))
    assert table.std_Ohm is not None
    np.testing.assert_allclose(table.std_Ohm, 0.01 * (4.31 - 2.7) / 12.0, rtol=1e-9)


@pytest.mark.parametrize("order", [1, 2])
def test_band_is_the_spread_over_drawn_parameters(order: int) -> None:
    network = hand_network.everything(order)
    rng = np.random.default_rng(5)
    root = 2e-6 * rng.standard_normal((network.theta.size, network.theta.size))
    axes = {"soc": [0.2, 0.8], "current_A": [-5.0, 3.0], "temperature_degC": [10.0]}
    table = resistance_table(network, **axes, local=LocalFactor(root))
    assert table.std_Ohm is not None
    draws = []
    for _ in range(400):
        moved = network.theta + (root @ rng.standard_normal(len(root))).reshape(network.theta.shape)
        draws.append(resistance_table(replace(network, theta=moved), **axes).resistance_Ohm)
    np.testing.assert_allclose(table.std_Ohm, np.std(draws, axis=0), rtol=0.2)


def test_a_negative_resistance_is_a_reservation() -> None:
    table = resistance_table(by_direction(np.array([0.08, -0.01, 0.1, 0.05])), temperature_degC=[10.0, 35.0])
    (text,) = table.reservations
    assert "not positive" in text and "-10.000 mOhm" in text and "35 degC" in text


@pytest.mark.parametrize(
    "axes", [{"current_A": [-1.0, 0.0]}, {"current_A": [2.0, 1.0]}, {"soc": [0.5, 0.5]}, {"temperature_degC": []}]
)
def test_axes_that_make_no_table_are_refused(axes: dict) -> None:
    with pytest.raises(ModelError, match="must rise"):
        resistance_table(by_direction(), **axes)
