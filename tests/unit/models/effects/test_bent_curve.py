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


def at_rest(bent: BentCurve) -> float:
    """Change of the capacity between the ends at rest."""
    return bent.aged.capacity / bent.fresh.capacity - 1.0


def test_near_full_it_is_the_difference_of_two_open_circuit_curves(fresh: HalfCells) -> None:
    bent, at = BentCurve(fresh, fresh.less_lithium(0.1)), np.array([1.0])
    bent_V = bent.voltage_V(at, np.zeros(1), at_rest(bent))
    np.testing.assert_allclose(bent_V, bent.aged.open_circuit_V(at) - fresh.open_circuit_V(at), atol=1e-4)


def test_steps_are_less_sharp_than_those_of_half_cells(fresh: HalfCells) -> None:
    bent = BentCurve(fresh, fresh.less_lithium(0.1))
    sharp_V = bent.aged.open_circuit_V(SOC) - fresh.open_circuit_V(SOC)
    bent_V = bent.voltage_V(SOC, REST, at_rest(bent))
    assert np.abs(np.gradient(bent_V)).max() < 0.8 * np.abs(np.gradient(sharp_V)).max()
    assert abs(np.mean(bent_V) - np.mean(sharp_V)) < 1e-3


def test_a_cell_that_ends_sooner_under_load_is_as_full_and_has_the_same_curve_per_charge(fresh: HalfCells) -> None:
    bent = BentCurve(fresh, fresh.less_lithium(0.1))
    change = at_rest(bent) - 0.02
    own_soc = 1.0 - (1.0 - SOC) * (1.0 + change) / (1.0 + at_rest(bent))
    aged_V = bent.voltage_V(own_soc, REST, at_rest(bent)) + fresh.open_circuit_V(own_soc)
    told_V = bent.voltage_V(SOC, REST, change) + fresh.open_circuit_V(SOC)
    # What is blunted is each curve over its own state of charge.
    np.testing.assert_allclose(told_V[20:], aged_V[20:], atol=4e-3)


def test_near_empty_it_stays_as_it_is_above(fresh: HalfCells) -> None:
    bent = BentCurve(fresh, fresh.less_positive(0.1))
    bent_V = bent.voltage_V(np.array([0.0, 0.05, 0.1, 0.2]), np.zeros(4), at_rest(bent))
    assert bent_V[0] == bent_V[1] == bent_V[2] != bent_V[3]


def test_surfaces_of_what_is_left_are_further_ahead(fresh: HalfCells) -> None:
    left = {name: 0.8 * getattr(fresh, name) for name in ("negative_Ah", "positive_Ah", "lithium_Ah")}
    bent = BentCurve(fresh, replace(fresh, **left))
    assert at_rest(bent) == pytest.approx(-0.2, abs=1e-6)
    np.testing.assert_allclose(bent.voltage_V(SOC, REST, -0.2), 0.0, atol=1e-4)
    charged_V, discharged_V = (bent.voltage_V(SOC, REST + each, -0.2) for each in (0.5, -0.5))
    assert np.mean(charged_V) > 5e-4 and np.mean(discharged_V) < -5e-4


def test_steps_of_the_negative_electrode_come_sooner_in_a_charge(fresh: HalfCells) -> None:
    bent = BentCurve(fresh, fresh.less_negative(0.15))
    only = replace(fresh, ahead=Ahead())
    still = BentCurve(only, only.less_negative(0.15))
    ahead = fresh.ahead.of_negative(SOC, REST + 0.5)
    assert ahead[0] < ahead[-1] and np.allclose(ahead[len(ahead) // 2], 0.05)
    change = at_rest(bent)
    charged_V, discharged_V = bent.voltage_V(SOC, REST + 0.5, change), bent.voltage_V(SOC, REST - 0.5, change)
    rest_V = still.voltage_V(SOC, REST, change)
    step = [SOC[60 + int(np.argmax(np.abs(each[60:-20])))] for each in (charged_V, rest_V, discharged_V)]
    assert step[0] < step[1] < step[2]
