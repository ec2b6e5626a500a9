import hashlib
from dataclasses import replace

import pytest

from simulators.catalogue import CELLS, cell_type
from simulators.cell_parameters import CellParameters
from simulators.effects import EFFECTS, apply_effects
from simulators.hidden_effect import BY_NAME, HIDDEN, STRUCTURAL, draw, game_cell
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


def made(cell: CellParameters, effects: dict[str, float]) -> CellParameters:
    return apply_effects(cell, SensorParameters(), effects)[0]


@pytest.mark.parametrize("cell", sorted(CELLS))
def test_the_game_of_a_structure_hides_one_of_the_parts_that_a_plain_cell_goes_without(cell: str) -> None:
    parameters = cell_type(cell).parameters
    bare = made(parameters, game_cell(parameters, "structure"))
    assert bare.hysteresis_amplitude_V == bare.charge_transfer_V == bare.slow.resistance_Ohm == 0.0
    drawn = [draw("random", parameters, seed, "structure") for seed in range(30)]
    assert {hidden.name for hidden in drawn} == set(STRUCTURAL)
    for hidden in drawn:
        assert hidden.before == 0.0
        # As large as it would be in the ordinary cell with the same effect: never less than that has.
        assert hidden.value > draw(hidden.name, parameters, 1).before > 0.0
        assert made(parameters, game_cell(parameters, "structure") | {hidden.name: hidden.value}) != bare


def test_charge_transfer_of_a_game_s_cell_bends_at_the_currents_of_a_campaign() -> None:
    for kind in CELLS.values():
        ordinary = kind.parameters
        for mode, rate in (("change", 1.0), ("structure", 0.5)):
            assert made(ordinary, game_cell(ordinary, mode)).exchange_current_A == rate * ordinary.capacity_Ah
        only = made(ordinary, game_cell(ordinary, "change"))
        assert replace(only, exchange_current_A=ordinary.exchange_current_A) == ordinary


def test_what_is_no_part_of_a_structure_is_hidden_by_its_name_as_ever() -> None:
    parameters = cell_type("nmc").parameters
    for mode in ("change", "structure"):
        assert draw("capacity", parameters, 3, mode).before == parameters.capacity_Ah


def test_the_seal_closes_the_contents_and_cannot_be_guessed_from_name_and_size() -> None:
    parameters = cell_type("nmc").parameters
    first, second = draw("hysteresis", parameters, 1), draw("hysteresis", parameters, 1)
    assert first.seal == hashlib.sha256(first.contents.encode()).hexdigest()
    assert first.seal != second.seal


def test_an_effect_that_cannot_be_hidden_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="one of active_material_loss, capacity"):
        draw("phlogiston", cell_type("nmc").parameters, 1)
