import numpy as np
import pytest

from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.identification.search.auto import stands_apart
from models.identification.search.circuit_start import circuit_alternatives, circuit_candidate, circuit_starts
from models.network.regression import CellContext, SignalBank
from tests.unit.models import synthetic


@pytest.mark.parametrize("warm", [True, False])
def test_the_search_begins_on_both_sides_and_ends(warm: bool) -> None:
    starts = circuit_starts(2.0, warm)
    rates = [candidate.hysteresis_rates[0] for candidate in starts]
    assert min(rates) < 12.0 and max(rates) > 40.0
    best, stage, tried = starts[0], 0, []
    while (found := circuit_alternatives(best, warm, stage)) is not None:
        tried += found
        stage += 1
    assert stage < 20
    assert () in {candidate.hysteresis_rates for candidate in tried}
    assert None in {candidate.exchange_c_rate for candidate in tried}
    assert all(candidate.surface is None for candidate in [*starts, *tried])
    assert {candidate.activation_K > 0.0 for candidate in [*starts, *tried]} == {warm}
    for candidate in [*starts, *tried]:
        candidate.structure(1.0)


def bank(current_A: np.ndarray) -> SignalBank:
    n = len(current_A)
    run = TimeSeries(np.arange(n) * 1.0, current_A, np.full(n, 3.7), np.full(n, 25.0))
    return SignalBank([to_grid(run, 1.0)], [0.9], CellContext(synthetic.CAPACITY_AH))


def test_a_slow_term_that_a_steady_discharge_cannot_show_is_not_taken() -> None:
    rng = np.random.default_rng(0)
    steady = np.full(5000, -1.0) + 0.2 * rng.standard_normal(5000)
    assert not stands_apart(circuit_candidate(synthetic.CAPACITY_AH, False), bank(steady))


def test_terms_that_pulses_both_ways_show_are_taken() -> None:
    rng = np.random.default_rng(0)
    both_ways = np.repeat(np.tile([-1.5, 1.5], 4), 2500) + np.repeat(rng.uniform(-4.0, 4.0, 400), 50)
    assert stands_apart(circuit_candidate(synthetic.CAPACITY_AH, False), bank(both_ways))
