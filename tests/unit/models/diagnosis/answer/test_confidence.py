"""How sure a named effect is."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.answer.confidence import SURE_ELSEWHERE, confidence, most_sure
from models.diagnosis.evidence.candidates import try_effect
from models.diagnosis.evidence.ranking import Ranking, rank
from tests.unit.models.diagnosis.hand_reference import compared, steps_A, true_run


@pytest.fixture(scope="module")
def ranking() -> Ranking:
    current = steps_A(600)
    comparison = compared(true_run(current, added_V=0.004 * current, noise_V=1e-3), ["series_resistance"], own_mse=1e-6)
    return replace(
        rank(comparison, [try_effect(comparison, each) for each in comparison.effects]), rivals=(), noise_V=1e-3
    )


def test_it_is_a_logistic_curve_over_the_logarithm_of_the_margin(ranking: Ranking) -> None:
    assert confidence(replace(ranking, margin=1.0)) == pytest.approx(1.0 / (1.0 + np.exp(-1.6)))
    odds = [p / (1.0 - p) for p in (confidence(replace(ranking, margin=each)) for each in (0.1, 1.0))]
    assert odds[1] / odds[0] == pytest.approx(10.0**0.52)


def test_it_grows_with_the_margin_and_never_is_certainty(ranking: Ranking) -> None:
    found = [confidence(replace(ranking, margin=each)) for each in (0.0, 0.01, 0.1, 1.0, 10.0, 1e9)]
    assert found == sorted(found)
    assert found[-1] == 0.985
    # A margin of nothing, or less, is one of half a percent.
    assert confidence(replace(ranking, margin=-3.0)) == found[0] > 0.1


def test_with_rivals_it_is_little_more_than_even(ranking: Ranking) -> None:
    assert confidence(replace(ranking, margin=1e9, rivals=("capacity",))) == 0.6
    low = replace(ranking, margin=0.01)
    assert confidence(replace(low, rivals=("capacity",))) == confidence(low) < 0.6


def test_of_a_cell_that_even_all_effects_leave_open_nothing_is_sure(ranking: Ranking) -> None:
    sure = replace(ranking, margin=1e9)
    assert confidence(replace(sure, own_V=1.4 * sure.noise_V)) == 0.985
    assert confidence(replace(sure, own_V=1.6 * sure.noise_V)) == 0.85
    assert confidence(replace(sure, noise_V=0.0)) == 0.85


def test_how_sure_anything_may_be_has_no_step() -> None:
    assert most_sure(1.0) == most_sure(1.3) == 1.0
    assert most_sure(1.5) == most_sure(4.0) == SURE_ELSEWHERE
    assert SURE_ELSEWHERE < most_sure(1.48) < 0.9
    factors = np.linspace(1.2, 1.6, 41)
    assert np.abs(np.diff([most_sure(factor) for factor in factors])).max() < 0.01
