"""Samples are looked at where the model was trained, also by the state of charge of the particles' surface."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.resampling import GridRun, to_grid
from models.diagnosis.known.cell import SURFACE
from models.diagnosis.known.elsewhere import points_of
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.likelihood.learning import know
from models.diagnosis.likelihood.sight import background, gain_of_start, look
from models.effects.view import View
from models.identification.bounded.variants import Variant
from simulators.catalogue import CELLS
from simulators.cell import Cell
from tests.unit.models.diagnosis.cells import SOC, measured
from tests.unit.models.simulated_cells import pulses_A, record

CELL = CELLS["nmc"].parameters


@pytest.fixture(scope="module")
def run() -> GridRun:
    return to_grid(measured(CELL, 1), 1.0)


@pytest.fixture(scope="module")
def memory(run: GridRun) -> KnownRuns:
    return know([run], [SOC], CELL.capacity_Ah, [], Variant(surface=(0.1, 200.0, 3500.0)))


def narrowed(memory: KnownRuns, low: float, high: float) -> KnownRuns:
    """As if the surface had been between two states of charge in all training runs."""
    return replace(memory, cell=replace(memory.cell, domain={**memory.cell.domain, SURFACE: (low, high)}))


def test_operating_points_are_those_of_the_surface(memory: KnownRuns, run: GridRun) -> None:
    view = View(memory.cell, run, SOC, np.arange(0, len(run), 50))
    surface = view.soc[view.index] + view.inputs.surface
    assert np.ptp(surface) > np.ptp(view.soc[view.index]) + 0.01
    assert memory.cell.surface_range == pytest.approx((surface.min(), surface.max()), abs=0.01)
    points = points_of(view, 0, memory.cell.domain)
    np.testing.assert_array_equal(points.soc, surface)
    # No further from the training than its own samples are; beyond a narrower range the error is expected to double.
    assert points.away.max() < 0.1
    middle = 0.5 * (surface.min() + surface.max())
    away = points_of(view, 0, narrowed(memory, middle, 1.0).cell.domain).away
    np.testing.assert_allclose(away, np.maximum(middle - surface, 0.0) / 0.05 + points.away, atol=0.1)


def test_samples_beyond_the_trained_surface_are_left_out(memory: KnownRuns, run: GridRun) -> None:
    assert look(memory, [run], [SOC]).share_inside > 0.99
    (low, high), soc = memory.cell.surface_range, memory.cell.soc_range
    part = look(narrowed(memory, 0.5 * (low + high), high), [run], [SOC])
    assert 0.1 < part.share_inside < 0.95
    (seen,) = part.runs
    points = seen.points.soc[seen.points.index] + seen.points.inputs.surface
    assert points.min() > 0.5 * (low + high) - 0.031
    # The mean state of charge is inside all the while.
    assert soc[0] <= seen.points.soc.min() + 1e-9
    with pytest.raises(ModelError, match="trained state of charge"):
        look(narrowed(memory, high + 0.1, high + 0.2), [run], [SOC])


def test_without_a_surface_it_is_the_mean_state_of_charge(run: GridRun) -> None:
    plain = know([run], [SOC], CELL.capacity_Ah, [], Variant())
    assert plain.cell.surface_range == plain.cell.soc_range


def down(soc: float, seed: int) -> GridRun:
    """Pulses from a state of charge down by a quarter, to where the curve bends."""
    current = pulses_A(6000, CELL.capacity_Ah, seed, rest=300) - 0.15 * CELL.capacity_Ah
    return to_grid(record(Cell(CELL, soc, 22.0), current, seed), 1.0)


def test_a_start_stated_a_little_off_where_the_curve_bends_is_no_news() -> None:
    bent = know([down(0.3, 1)], [0.3], CELL.capacity_Ah, [], Variant())
    run, std = down(0.28, 2), [0.005, 0.005]
    # Just what the known cell does from 0.28 on: all that is wrong is what is stated.
    run = replace(run, voltage_V=View(bent.cell, run, 0.28, np.arange(len(run))).voltage_V)

    def losses(*stated: float) -> tuple[float, float]:
        """By how much nothing is less likely than from the right starts, along the slope and with its gain."""
        found = []
        for soc in ([0.28] * len(stated), list(stated)):
            sight = look(bent, [run] * len(stated), soc)
            back = background(sight, std[: len(soc)], np.zeros((len(sight.own_rows[0]), 0)))
            found.append((back.nothing, gain_of_start(sight, back, std[: len(soc)])))
        (right, no_gain), (along, gain) = found
        assert no_gain == 0.0
        return right - along, right - along - gain

    for off in (-0.0125, 0.0125):
        along, moved = losses(0.28 + off)
        assert moved < 0.65 * along or moved < 4.0
        # Two and a half standard deviations of a statement cost half their square; other points are looked at, too.
        assert -5.0 < moved < 10.0
    along, moved = losses(0.28 + 0.0125, 0.28)
    assert 0.0 < moved < 0.8 * along
    # Ten of them are another state of charge than the stated one.
    assert losses(0.33)[1] > 100.0


def test_where_nothing_of_a_start_is_open_it_is_not_moved(memory: KnownRuns, run: GridRun) -> None:
    sight = look(memory, [run], [SOC + 0.02])
    back = background(sight, None, np.zeros((len(sight.own_rows[0]), 0)))
    assert gain_of_start(sight, back, None) == 0.0
