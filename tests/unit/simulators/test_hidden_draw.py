import hashlib

import pytest

from simulators.catalogue import CELLS, cell_type
from simulators.effects import EFFECTS, apply_effects
from simulators.hidden_effect import BY_NAME, HIDDEN, draw
from simulators.sensors import SensorParameters


@pytest.mark.parametrize("cell", sorted(CELLS))
@pytest.mark.parametrize("name", sorted((*HIDDEN, *BY_NAME)))
def test_whatever_is_drawn_can_be_built_and_changes_the_cell(cell: str, name: str) -> None:
    parameters, sensors = cell_type(cell).parameters, SensorParameters()
    for seed in range(5):
        hidden = draw(name, parameters, seed)
        assert hidden.unit == EFFECTS[name].unit
        assert apply_effects(parameters, sensors, {hidden.name: hidden.value}) != (parameters, sensors)


def test_a_seed_draws_the_same_effect_and_seeds_draw_different_ones() -> None:
    parameters = cell_type("nmc").parameters
    drawn = [draw("random", parameters, seed) for seed in range(60)]
    again = [draw("random", parameters, seed) for seed in range(60)]
    assert [(d.name, d.value) for d in drawn] == [(d.name, d.value) for d in again]
    assert {d.name for d in drawn} == set(HIDDEN)


def test_the_seal_closes_the_contents_and_cannot_be_guessed_from_name_and_size() -> None:
    parameters = cell_type("nmc").parameters
    first, second = draw("hysteresis", parameters, 1), draw("hysteresis", parameters, 1)
    assert first.seal == hashlib.sha256(first.contents.encode()).hexdigest()
    assert first.seal != second.seal


def test_an_effect_that_cannot_be_hidden_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="one of active_material_loss, capacity"):
        draw("phlogiston", cell_type("nmc").parameters, 1)
