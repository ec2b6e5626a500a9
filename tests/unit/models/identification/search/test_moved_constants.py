"""Moving the constants of a structure's signals together."""

import numpy as np
import pytest

from models.data.timeseries import FloatArray
from models.identification.search.auto import AutoCandidate
from models.identification.search.moved_constants import constants, moved, with_constants
from models.network.signals.direction import hysteresis_state
from models.network.signals.filters import low_pass

CIRCUIT = AutoCandidate(2.0, time_constants_s=(2.0, 500.0), hysteresis_rates=(25.0,), activation_K=2500.0)


def _errors(candidate: AutoCandidate) -> FloatArray:
    """Difference to a cell with 40 s and 1500 s and a hysteresis of rate 12, in which these stand in for each other."""
    current = np.repeat(np.random.default_rng(1).choice([-2.0, -1.0, 0.0, 1.0], 60), 100)

    def parts(times_s: tuple[float, ...], rate: float) -> FloatArray:
        slow = [low_pass(current, tau_s, 1.0) for tau_s in times_s]
        return np.column_stack([*slow, hysteresis_state(current, rate, 1.0, 2.0)])

    truth = parts((40.0, 1500.0), 12.0) @ np.array([0.01, 0.012, 0.025])
    tried = parts(candidate.time_constants_s, candidate.hysteresis_rates[0])
    return truth - tried @ np.linalg.lstsq(tried, truth, rcond=None)[0]


def test_constants_that_stand_in_for_each_other_are_found_together() -> None:
    start = AutoCandidate(2.0, time_constants_s=(20.0, 800.0), hysteresis_rates=(25.0,))
    found = moved(moved(start, _errors), _errors)
    assert found.time_constants_s == pytest.approx((40.0, 1500.0), rel=0.03)
    assert found.hysteresis_rates == pytest.approx((12.0,), rel=0.03)


def test_every_constant_can_be_read_and_put_back() -> None:
    full = AutoCandidate(
        2.0,
        activation_K=2500.0,
        second_activation_K=7500.0,
        exchange_c_rate=0.6,
        surface=(0.05, 400.0, 2500.0),
        squared=(30.0, 0.0),
        hysteresis_rates=(20.0, 100.0),
    )
    values = constants(full)
    assert with_constants(full, values) == full
    assert len(values) == len(full.time_constants_s) + 3 + 3 + 1 + 2
    assert ("squared", 1) not in values
    double = with_constants(full, {key: 2.0 * value for key, value in values.items()})
    assert double.surface == (0.1, 800.0, 5000.0)
    assert double.second_activation_K == 12000.0


def test_what_may_not_be_used_is_not_moved_to() -> None:
    assert moved(CIRCUIT, lambda candidate: None) == CIRCUIT
    assert moved(CIRCUIT, lambda candidate: np.ones(5) if candidate == CIRCUIT else None) == CIRCUIT


def test_constants_of_which_the_errors_show_nothing_stay() -> None:
    assert moved(CIRCUIT, lambda candidate: np.ones(5)) == CIRCUIT
