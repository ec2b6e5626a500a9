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
from models.diagnosis.likelihood.sight import look
from models.effects.view import View
from models.identification.bounded.variants import Variant
from simulators.catalogue import CELLS
from tests.unit.models.diagnosis.cells import SOC, measured

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
