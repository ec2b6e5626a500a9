"""Networks that no cell can be, and the nearest that one can."""

import numpy as np
import pytest

from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.readouts.ocv import ocv_table
from models.readouts.possible_cell import made_possible
from models.readouts.resistance import resistance_table
from tests.unit.models.hand_network import network

_STRUCTURE = Structure(
    0, (InputChannel("soc", delay=1), InputChannel("current")), (PartitionAxis("soc", initial=3, k_sigma=0.4),), 1.0
)


def cell(slopes_V: tuple[float, ...], resistances_Ohm: tuple[float, ...]) -> LocalModelNetwork:
    """Three local models over the state of charge: slope of the curve, resistance, and a common 3.4 V."""
    return network(_STRUCTURE, np.array([[s, r, 3.4] for s, r in zip(slopes_V, resistances_Ohm, strict=True)]))


def is_possible(model: LocalModelNetwork) -> bool:
    rises = bool((np.diff(ocv_table(model).voltage_V, axis=-1) >= 0.0).all())
    return rises and bool((resistance_table(model).resistance_Ohm > 0.0).all())


def test_what_can_be_stays_the_very_same() -> None:
    model = cell((0.7, 0.7, 0.7), (0.02, 0.03, 0.02))
    assert made_possible(model, np.eye(9)) is model


@pytest.mark.parametrize(
    ("slopes_V", "resistances_Ohm"),
    [((0.7, 0.7, 0.7), (0.02, -0.01, 0.02)), ((0.7, -0.6, 0.7), (0.02, 0.02, 0.02))],
)
def test_a_negative_resistance_and_a_falling_curve_are_mended(
    slopes_V: tuple[float, ...], resistances_Ohm: tuple[float, ...]
) -> None:
    model = cell(slopes_V, resistances_Ohm)
    assert not is_possible(model)
    assert is_possible(made_possible(model, 0.01 * np.eye(9)))


def test_what_the_data_determine_stays_and_what_they_leave_open_gives_way() -> None:
    model = cell((0.7, 0.7, 0.7), (0.02, -0.01, 0.02))
    known = np.diag([1e-6, 1e-6, 1e-6, 1e-6, 0.1, 1e-6, 1e-6, 1e-6, 1e-6])
    change = (made_possible(model, known).theta - model.theta).ravel()
    assert change[4] > 0.0
    assert np.abs(np.delete(change, 4)).max() < 1e-3 * change[4]


def test_where_nothing_can_give_way_the_network_stays_and_its_tables_say_so() -> None:
    model = cell((0.7, 0.7, 0.7), (0.02, -0.01, 0.02))
    assert made_possible(model, np.zeros((9, 9))) is model
    assert "not positive" in " ".join(resistance_table(model).reservations)


def test_a_network_that_nowhere_settles_stays_as_it_is() -> None:
    fed_back = Structure(1, _STRUCTURE.inputs, _STRUCTURE.axes, 1.0)
    model = network(fed_back, np.array([[1.1, 0.07, 0.002, -0.34]] * 3))
    assert made_possible(model, np.eye(12)) is model
