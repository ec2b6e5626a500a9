"""Electrodes found in a full cell's curve, and what it is like when they have aged."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from models.effects import effect
from models.effects.electrode_shift import loss_shift
from models.effects.half_cell_curves import NEGATIVES, POSITIVES
from models.effects.half_cells import HalfCells, half_cells
from tests.unit.models.effects.linear_cell import CurvedCell, LinearCell, linear_view

SOC = np.linspace(0.05, 0.95, 19)
# Fillings of the negative and of the positive electrode, empty and full.
MADE = {
    ("graphite", "nmc532"): (0.02, 0.83, 0.90, 0.27),
    ("graphite-silicon", "nmc811"): (0.03, 0.90, 0.90, 0.27),
    ("graphite", "olivine"): (0.01, 0.80, 0.93, 0.04),
    ("graphite", "nca"): (0.02, 0.85, 0.96, 0.45),
}


def cell(pair: tuple[str, str]) -> CurvedCell:
    x0, x1, y0, y1 = MADE[pair]
    negative, positive = NEGATIVES[pair[0]], POSITIVES[pair[1]].potential_V
    return CurvedCell(curve=lambda soc: positive(y0 + soc * (y1 - y0)) - negative(x0 + soc * (x1 - x0)))


@pytest.mark.parametrize("name", sorted(NEGATIVES))
def test_negative_curves_fall_as_they_are_filled(name: str) -> None:
    assert (np.diff(NEGATIVES[name](np.linspace(-0.04, 1.05, 400))) < 0.0).all()


@pytest.mark.parametrize("name", sorted(POSITIVES))
def test_positive_curves_fall_as_they_are_filled(name: str) -> None:
    curve = POSITIVES[name]
    potential_V = curve.potential_V(np.linspace(curve.low, curve.high, 400))
    assert (np.diff(potential_V) < 0.0).all() and 2.0 < potential_V.min() < potential_V.max() < 4.7


@pytest.mark.parametrize("pair", sorted(MADE))
def test_electrodes_of_published_curves_are_found(pair: tuple[str, str]) -> None:
    x0, x1, y0, y1 = MADE[pair]
    found = half_cells(cell(pair))
    assert found is not None and found.left_V < 2e-3
    assert found.negative == pair[0]
    assert found.negative_Ah == pytest.approx(1.0 / (x1 - x0), rel=0.05)
    assert found.positive_Ah == pytest.approx(1.0 / (y0 - y1), rel=0.05)
    assert found.capacity == pytest.approx(1.0, abs=1e-3)
    np.testing.assert_allclose(found.open_circuit_V(SOC), cell(pair).open_circuit_V(SOC), atol=6e-3)


def test_lost_lithium_takes_nearly_as_much_capacity_and_moves_the_negative_steps_down() -> None:
    fresh = half_cells(cell(("graphite", "nmc532")))
    assert fresh is not None
    aged = fresh.less_lithium(0.1)
    assert 0.88 < aged.capacity < 0.93
    soc = np.linspace(0.3, 0.8, 501)
    # Graphite's last stage ends at a step of the cell's voltage: less lithium is in it at the same state of charge.
    steps = [soc[np.argmax(np.gradient(each.open_circuit_V(soc)))] for each in (fresh, aged)]
    assert steps[1] > steps[0] + 0.03
    # The counted charge at the step is that of the negative electrode, whatever else has gone.
    charge = [low + soc * (high - low) for soc, (low, high) in zip(steps, (fresh.ends, aged.ends), strict=True)]
    assert charge[1] == pytest.approx(charge[0], abs=5e-3)


@pytest.mark.parametrize("smaller", [HalfCells.less_negative, HalfCells.less_positive])
def test_a_smaller_electrode_takes_less_capacity_than_its_share(smaller: Callable[..., HalfCells]) -> None:
    fresh = half_cells(cell(("graphite", "nmc532")))
    assert fresh is not None
    assert 0.9 < smaller(fresh, 0.1).capacity < 1.0


def test_a_curve_that_no_published_ones_make_is_learned_with_graphite() -> None:
    found = half_cells(LinearCell())
    assert found is not None and found.left_V > 0.004 and found.negative == "graphite"
    inner = SOC[2:-2]
    np.testing.assert_allclose(found.open_circuit_V(inner), LinearCell().open_circuit_V(inner), atol=0.05)


def test_a_flat_positive_electrode_is_taken_as_filled_as_usual() -> None:
    # The plateau's slope is not quite the published one: alone it asks for one that is filled the other way round.
    made = cell(("graphite", "olivine"))
    found = half_cells(CurvedCell(curve=lambda soc: made.curve(soc) - 0.06 * soc, soc_range=(0.1, 0.8)))
    assert found is not None
    assert 1.0 < found.positive_Ah < 1.5
    assert found.less_lithium(0.1).capacity == pytest.approx(0.9, abs=0.02)


def test_cells_without_lithium_have_no_such_electrodes() -> None:
    nimh = CurvedCell(curve=lambda soc: 1.25 + 0.1 * soc)
    assert half_cells(nimh) is None
    shift = effect("lithium_loss").shift
    assert shift is not None
    view = linear_view(nimh)
    assert np.abs(shift.voltage(view, 0.1)).max() == 0.0


def test_a_loss_moves_charge_and_curve_together() -> None:
    made = cell(("graphite", "nmc532"))
    view, fresh, shift = linear_view(made), half_cells(made), effect("lithium_loss").shift
    assert fresh is not None and shift is not None and shift.soc is not None
    aged = fresh.less_lithium(0.1)
    soc = shift.soc(view, 0.1)
    np.testing.assert_allclose(soc - 0.5, (view.soc - 0.5) / aged.capacity * fresh.capacity, atol=1e-12)
    bent_V = (aged.open_circuit_V(soc) - fresh.open_circuit_V(soc))[view.index]
    np.testing.assert_allclose(shift.voltage(view, 0.1), view.moved(soc=soc) + bent_V, atol=1e-9)
    # And what is left of the cell is told beside the share.
    assert shift.also(view, 0.1) == pytest.approx((view.capacity_Ah * aged.capacity / fresh.capacity,))


def test_electrodes_that_reach_the_limits_no_more_are_no_division_by_zero() -> None:
    def gone(fresh: HalfCells, _share: float) -> HalfCells:
        return replace(fresh, limits_V=(9.0, 9.5))

    made = cell(("graphite", "nmc532"))
    fresh = half_cells(made)
    assert fresh is not None and gone(fresh, 0.1).capacity == 0.0
    assert np.isfinite(loss_shift(gone).voltage(linear_view(made), 0.1)).all()


def test_either_electrode_is_told_by_its_name() -> None:
    found = effect("active_material_loss")
    assert found.shift is not None
    told = [each.of for each in (found.shift, *found.or_shifts)]
    # Once by published curves, once by the steps of the cell's own.
    assert told == 2 * [" of the negative electrode", " of the positive electrode"]


@pytest.mark.parametrize("name", ["lithium_loss", "active_material_loss"])
def test_nothing_is_promised_of_electrodes_that_nobody_knows(name: str) -> None:
    promised = effect(name).expected.found_from
    assert promised is not None
    sure = replace(cell(("graphite", "nmc532")), soc_range=(0.02, 0.98))
    electrodes = half_cells(sure)
    assert electrodes is not None and electrodes.sure
    assert promised(linear_view(sure)) == 0.0
    assert promised(linear_view(LinearCell())) == np.inf
