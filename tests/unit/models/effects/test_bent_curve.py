"""What a loss does to a cell's voltage under current."""

from dataclasses import replace

import numpy as np
import pytest

from models.effects.bent_curve import BentCurve
from models.effects.electrode_match import Ahead
from models.effects.half_cells import HalfCells, half_cells
from tests.unit.models.effects.test_half_cells import cell

SOC = np.linspace(0.1, 0.9, 161)
REST = 0.0 * SOC


@pytest.fixture(scope="module")
def fresh() -> HalfCells:
    found = half_cells(cell(("graphite", "nmc532")))
    assert found is not None
    return replace(found, ahead=Ahead(0.1, 0.0, 0.05, 0.0))


def test_near_the_ends_it_is_the_difference_of_two_open_circuit_curves(fresh: HalfCells) -> None:
    aged, at = fresh.less_lithium(0.1), np.array([0.0, 1.0])
    bent_V = BentCurve(fresh, aged).voltage_V(at, np.zeros(2))
    np.testing.assert_allclose(bent_V, aged.open_circuit_V(at) - fresh.open_circuit_V(at), atol=1e-4)


def test_steps_are_less_sharp_than_those_of_half_cells(fresh: HalfCells) -> None:
    aged = fresh.less_lithium(0.1)
    sharp_V = aged.open_circuit_V(SOC) - fresh.open_circuit_V(SOC)
    bent_V = BentCurve(fresh, aged).voltage_V(SOC, REST)
    assert np.abs(np.gradient(bent_V)).max() < 0.8 * np.abs(np.gradient(sharp_V)).max()
    assert abs(np.mean(bent_V) - np.mean(sharp_V)) < 1e-3


def test_steps_of_the_negative_electrode_come_sooner_in_a_charge(fresh: HalfCells) -> None:
    bent = BentCurve(fresh, fresh.less_negative(0.15))
    only = replace(fresh, ahead=Ahead())
    still = BentCurve(only, only.less_negative(0.15))
    ahead = fresh.ahead.of_negative(SOC, REST + 0.5)
    assert ahead[0] < ahead[-1] and np.allclose(ahead[len(ahead) // 2], 0.05)
    charged_V, discharged_V = bent.voltage_V(SOC, REST + 0.5), bent.voltage_V(SOC, REST - 0.5)
    rest_V = still.voltage_V(SOC, REST)
    step = [SOC[60 + int(np.argmax(np.abs(each[60:-20])))] for each in (charged_V, rest_V, discharged_V)]
    assert step[0] < step[1] < step[2]
