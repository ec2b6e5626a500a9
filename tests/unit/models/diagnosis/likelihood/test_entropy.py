"""An entropic coefficient shows in both channels: as heat that turns with the current, and over the temperature."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import to_grid
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.likelihood.background import Background
from models.diagnosis.likelihood.learning import know
from models.diagnosis.likelihood.shapes import Linear, shapes_of
from models.diagnosis.likelihood.sight import look
from models.diagnosis.likelihood.tried import try_shapes
from models.diagnosis.likelihood.verdict import judge
from models.effects import Effect, effect
from models.identification.bounded.variants import Variant
from simulators.catalogue import CELLS
from tests.unit.models.diagnosis.cells import SOC, measured

CELL = CELLS["nmc"].parameters
ENTROPY, HEAT = effect("entropic_voltage"), effect("reversible_heat")
USUAL_V_PER_K = 2e-4
N = 60
TIME = np.linspace(0.0, 1.0, N)


@pytest.fixture(scope="module")
def memory() -> KnownRuns:
    return know([to_grid(measured(CELL, 1), 1.0)], [SOC], CELL.capacity_Ah, [], Variant())


def test_it_is_looked_for_by_its_heat_where_the_temperature_stands_still(memory: KnownRuns) -> None:
    run = measured(CELL, 2)
    still = np.full_like(run.temperature_degC, 15.0)
    sight = look(memory, [to_grid(replace(run, temperature_degC=still, ambient_degC=still), 1.0)], [SOC])
    (shape,) = shapes_of(sight, ENTROPY)
    assert isinstance(shape, Linear)
    (seen,) = sight.runs
    assert seen.warm is not None and HEAT.warmth is not None
    mean, along = shape.columns.T
    # The same heat as of the effect that is heat alone; the curve is lower by as much for each of ten kelvins.
    heat_K = (HEAT.warmth.temperature(seen.warm, (USUAL_V_PER_K,)) - seen.warm.simulated())[seen.warm_place]
    np.testing.assert_allclose(mean[sight.n_voltage :], heat_K, atol=1e-12)
    assert np.abs(heat_K).max() > 0.05
    np.testing.assert_allclose(mean[: sight.n_voltage], -10.0 * USUAL_V_PER_K)
    # What changes along the state of charge heats there alone as it moves the curve there.
    assert np.abs(along[sight.n_voltage :]).max() > 0.02
    assert not np.allclose(along[sight.n_voltage :], 0.5 * heat_K)


def test_without_a_heat_balance_it_is_not_looked_for_there(memory: KnownRuns) -> None:
    run = measured(CELL, 2)
    still = np.full_like(run.temperature_degC, 15.0)
    grid = to_grid(replace(run, temperature_degC=still, ambient_degC=still), 1.0)
    assert shapes_of(look(replace(memory, balance=None), [grid], [SOC]), ENTROPY) == ()


def test_heat_that_is_asked_for_is_an_entropy_though_an_error_hides_its_voltage() -> None:
    # The model's own error and what the entropy adds to the voltage nearly cancel: its heat is there all the same.
    entropy, heat = _chances(ENTROPY, HEAT)
    assert entropy > 2.0 * heat > 0.0
    # Where nothing else asks for that heat, what raises the voltage's error is an explanation by what nobody knows.
    assert _chances(effect("series_resistance"), HEAT)[0] == 0.0


def _chances(both_ways: Effect, heat_alone: Effect) -> tuple[float, float]:
    """Probability of an effect in both channels and of its heat alone, the voltage's error a tenth of what it adds."""
    heat_K, moved_V = np.sin(7.0 * TIME), 0.004 * TIME
    error = np.concatenate([0.1 * moved_V, heat_K])
    noise = np.diag(np.concatenate([np.full(N, 1e-8), np.full(N, 1e-2)]))
    open_V = np.concatenate([0.01 * TIME, np.zeros(N)])
    back = Background(error, noise + np.outer(open_V, open_V), 1e-10 * np.eye(2 * N))
    tried = [
        try_shapes(back, one, (Linear(np.concatenate([volts, heat_K])[:, None], (), (), 0),))
        for one, volts in ((both_ways, moved_V), (heat_alone, np.zeros(N)))
    ]
    chances = {each.effect.name: p for p, each in judge(back, tried, N).single}
    return chances[both_ways.name], chances[heat_alone.name]
