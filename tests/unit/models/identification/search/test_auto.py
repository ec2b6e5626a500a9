"""What `--structure auto` offers to the data."""

import numpy as np
import pytest

from models.identification.search.auto import alternatives, find_offer, first_candidate, share_of_soc, shows_hysteresis
from models.network.regression import CellContext, SignalBank
from models.network.structure import Structure
from tests.unit.models.hand_network import grid_run

CELL = CellContext(2.0)


def _bank(current_A: np.ndarray, temperature_degC: np.ndarray | float = 25.0) -> SignalBank:
    return SignalBank([grid_run(current_A, temperature_degC)], [1.0], CELL)


def _steady() -> np.ndarray:
    return np.full(6000, -1.0)


def _pulses() -> np.ndarray:
    rng = np.random.default_rng(5)
    return np.repeat(rng.choice([-2.0, 0.0, 1.0], 60), 100)


def test_a_slow_low_pass_is_a_function_of_soc_at_one_constant_current_but_not_in_pulses() -> None:
    assert share_of_soc(_bank(_steady()), "low_pass:3000") > 0.95
    assert share_of_soc(_bank(_pulses()), "low_pass:100") < 0.5


def test_constant_current_is_offered_no_slow_low_pass_and_no_slow_hysteresis() -> None:
    offer = find_offer(_bank(_steady()))
    assert offer.longest_s == 100.0
    assert all(10.0 not in rates for rates in offer.hysteresis_rates)


def test_temperature_is_offered_only_where_it_varies() -> None:
    constant = find_offer(_bank(_pulses()))
    varied = find_offer(_bank(_pulses(), np.linspace(10.0, 30.0, 6000)))
    assert first_candidate(2.0, constant).activation_K == 0.0
    assert first_candidate(2.0, varied).activation_K > 0.0
    tried = [c for stage in range(22) for c in alternatives(first_candidate(2.0, constant), constant, stage)]
    assert all(c.temperature_parts == 0 and not c.entropic for c in tried)


def test_hysteresis_is_offered_only_where_it_moves_to_both_sides() -> None:
    both_ways = np.repeat(np.tile([-2.0, 2.0], 10), 300)
    short_charging = np.tile(np.concatenate([np.full(590, -0.5), np.full(10, 1.0)]), 10)
    assert shows_hysteresis(_bank(both_ways), 40.0)
    assert not shows_hysteresis(_bank(short_charging), 40.0)


def test_parts_of_the_resistance_that_temperature_moves_unlike_are_offered() -> None:
    offer = find_offer(_bank(_pulses(), np.linspace(10.0, 30.0, 6000)))
    tried = [c for stage in range(22) for c in alternatives(first_candidate(2.0, offer), offer, stage)]
    apart = next(c for c in tried if c.second_activation_K and c.unscaled)
    signals = apart.structure(1.0).signals
    assert {"current", f"scaled_current:{apart.activation_K:g}", f"scaled_current:{apart.second_activation_K:g}"} <= {
        *signals
    }


def test_over_a_few_kelvin_one_activation_is_all_that_is_offered() -> None:
    offer = find_offer(_bank(_pulses(), np.linspace(24.0, 31.0, 6000)))
    tried = [c for stage in range(22) for c in alternatives(first_candidate(2.0, offer), offer, stage)]
    assert {c.activation_K for c in tried} > {0.0, 2500.0}
    assert not any(c.second_activation_K or (c.activation_K and c.unscaled) for c in tried)


def test_unknown_temperature_counts_as_none() -> None:
    assert find_offer(_bank(_pulses(), np.nan)).temperature_range_K == 0.0


@pytest.mark.parametrize("stage", range(22))
def test_every_alternative_is_a_valid_structure(stage: int) -> None:
    offer = find_offer(_bank(_pulses(), np.linspace(10.0, 30.0, 6000)))
    for candidate in alternatives(first_candidate(2.0, offer), offer, stage):
        structure = candidate.structure(1.0)
        assert Structure.from_json(structure.to_json()) == structure


def test_the_stages_come_to_an_end() -> None:
    offer = find_offer(_bank(_pulses()))
    assert alternatives(first_candidate(2.0, offer), offer, 99) == []
