"""Electrodes of a cell whose materials nobody knows: what is sharp in its curve is the negative one's."""

import numpy as np
import pytest

from models.data.timeseries import FloatArray
from models.effects import effect
from models.effects.half_cell_curves import NEGATIVES, POSITIVES
from models.effects.half_cells import half_cells
from models.effects.own_electrodes import OwnElectrodes, own_electrodes
from tests.unit.models.effects.linear_cell import CurvedCell, linear_view

SOC = np.linspace(0.02, 0.98, 193)
RANGE = (0.02, 0.98)
INNER = np.linspace(0.15, 0.95, 161)


def step(soc: FloatArray, height_V: float, centre: float, width: float) -> FloatArray:
    return 0.5 * height_V * (1.0 + np.tanh((soc - centre) / (2.0 * width)))


def positive_V(soc: FloatArray) -> FloatArray:
    """A smooth fall that gets faster towards full, of no published material."""
    return 3.5 + 0.25 * soc + 0.2 * soc**3


def negative_V(soc: FloatArray) -> FloatArray:
    """Two stages and the empty end."""
    return 0.5 * np.exp(-soc / 0.03) - step(soc, 0.11, 0.31, 0.025) - step(soc, 0.09, 0.66, 0.03)


def unknown() -> CurvedCell:
    return CurvedCell(curve=lambda soc: positive_V(soc) - negative_V(soc), soc_range=RANGE)


def test_they_make_the_cell_s_own_curve() -> None:
    found = own_electrodes(unknown())
    assert isinstance(found, OwnElectrodes) and not found.sure
    np.testing.assert_allclose(found.open_circuit_V(SOC), unknown().curve(SOC), atol=4e-3)
    assert found.ends[1] - found.ends[0] == pytest.approx(1.0, abs=2e-3)


def test_steps_and_the_empty_end_are_the_negative_one_s() -> None:
    found = own_electrodes(unknown())
    assert found is not None
    negative, positive = found.electrodes_V(INNER)
    # What lies between two steps is given to the other electrode, so that a step may be lower, but not elsewhere.
    fall, true = -np.diff(negative), -np.diff(negative_V(INNER))
    assert 0.7 < fall.sum() / true.sum() < 1.05
    assert np.corrcoef(fall, true)[0, 1] > 0.98
    np.testing.assert_allclose(positive - positive[-1], positive_V(INNER) - positive_V(INNER)[-1], atol=0.06)
    # It falls smoothly: nowhere does its slope get smaller towards full.
    assert (np.diff(positive, 2) > -1e-6).all()


@pytest.mark.parametrize("share", [0.04, 0.1])
def test_lost_lithium_moves_all_steps_by_as_much_charge_and_takes_as_much_capacity(share: float) -> None:
    fresh = own_electrodes(unknown())
    assert fresh is not None
    aged = fresh.less_lithium(share)
    assert 1.0 - aged.capacity == pytest.approx(share, rel=0.1)
    for low, high in ((0.2, 0.45), (0.55, 0.8)):
        soc = np.linspace(low, high + 0.1, 701)
        at = []
        for cell in (fresh, aged):
            charge = cell.ends[0] + soc * (cell.ends[1] - cell.ends[0])
            at.append(charge[np.argmax(np.gradient(cell.open_circuit_V(soc), soc) / cell.capacity)])
        # Where the negative electrode has its step, whatever else has gone.
        assert at[1] == pytest.approx(at[0], abs=4e-3)


def test_a_cell_of_published_materials_or_without_lithium_has_none() -> None:
    assert own_electrodes(CurvedCell(curve=lambda soc: 1.25 + 0.1 * soc)) is None
    negative, positive = NEGATIVES["graphite"], POSITIVES["nmc532"].potential_V
    known = CurvedCell(curve=lambda soc: positive(0.9 - 0.63 * soc) - negative(0.02 + 0.81 * soc), soc_range=RANGE)
    electrodes = half_cells(known)
    assert electrodes is not None and electrodes.sure and own_electrodes(known) is None


def test_a_loss_is_tried_by_them_too() -> None:
    lost = effect("lithium_loss")
    (by_steps,) = lost.or_shifts
    view = linear_view(unknown())
    assert np.abs(by_steps.voltage(view, 0.1)).max() > 1e-3
    nimh = linear_view(CurvedCell(curve=lambda soc: 1.25 + 0.1 * soc))
    assert np.abs(by_steps.voltage(nimh, 0.1)).max() == 0.0
