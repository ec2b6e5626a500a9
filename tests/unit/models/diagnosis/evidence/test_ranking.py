"""What is named of several effects, what it is confused with, and when nothing is named."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.evidence.candidates import Comparison, noise_V2, try_effect
from models.diagnosis.evidence.ranking import Ranking, rank
from models.network.signals.direction import hysteresis_state
from tests.unit.models.diagnosis.hand_reference import RESISTANCE_OHM, SLOPE_V, compared, steps_A, true_run
from tests.unit.models.hand_network import CAPACITY_AH

CURRENT_A = steps_A(3000, largest_A=4.0, length=60)
NOISE_V = 1e-3


def ranked(comparison: Comparison) -> Ranking:
    return rank(comparison, [try_effect(comparison, each) for each in comparison.effects])


def ranking_of(added_V: np.ndarray | float, *names: str, own_mse: float = NOISE_V**2) -> Ranking:
    """Of what is added to the cell of the hand-made model, measured with noise."""
    run = true_run(CURRENT_A, added_V=added_V, noise_V=NOISE_V, seed=5)
    return ranked(compared(run, names, own_mse=own_mse, noise_mse=NOISE_V**2))


@pytest.fixture(scope="module")
def drop() -> Ranking:
    return ranking_of(0.004 * CURRENT_A, "voltage_offset", "series_resistance", "hysteresis")


def test_the_effect_that_is_there_comes_first(drop: Ranking) -> None:
    assert drop.candidates[0].effect.name == "series_resistance"
    assert drop.significant and drop.explained and not drop.unknown
    assert drop.rivals == ()


def test_figures_of_the_named_effect(drop: Ranking) -> None:
    size_V = 0.004 * np.sqrt(np.mean(CURRENT_A**2))
    assert drop.size_V == pytest.approx(size_V, rel=0.02)
    assert drop.ratio == pytest.approx((size_V**2 + NOISE_V**2) / NOISE_V**2, rel=0.05)
    assert drop.share == pytest.approx(size_V**2 / (size_V**2 + NOISE_V**2), rel=0.02)
    assert drop.share_of_new == pytest.approx(1.0, abs=0.01)
    assert drop.held_out_share == pytest.approx(drop.share, abs=0.01)
    assert drop.figures["size_mV"] == 1e3 * drop.size_V and drop.figures["n_rivals"] == 0


def test_nothing_is_significant_where_only_noise_is_left() -> None:
    nothing = ranking_of(0.0, "voltage_offset", "series_resistance", "hysteresis")
    assert not nothing.something_new and not nothing.significant and not nothing.unknown
    assert nothing.ratio == pytest.approx(1.0, abs=0.1)


def test_what_no_effect_explains_is_unknown() -> None:
    ripple_V = 0.01 * np.sign(np.sin(np.arange(3000) / 7.0))
    found = ranking_of(ripple_V, "voltage_offset", "series_resistance")
    assert found.something_new and found.ratio > 50.0
    assert found.unknown and not found.explained


def test_the_same_error_is_nothing_new_for_a_model_that_is_as_wrong_itself() -> None:
    ripple_V = 0.01 * np.sign(np.sin(np.arange(3000) / 7.0))
    found = ranking_of(ripple_V, "voltage_offset", "series_resistance", own_mse=1e-4)
    assert not found.something_new and not found.unknown
    # A model that is 10 mV off in one record says nothing below about 6 mV in another.
    assert found.least_V == pytest.approx(0.2 * 0.01 + 0.4 * np.sqrt(1e-4 - NOISE_V**2), rel=1e-6)


@pytest.mark.parametrize(("ripple_mV", "new"), [(13.0, False), (17.0, True)])
def test_a_model_that_is_wrong_in_one_record_is_about_as_wrong_in_another(ripple_mV: float, new: bool) -> None:
    """Of a squared error of 100 mV^2, nearly all of it systematic, 1.28 times as much may come on top."""
    ripple_V = 1e-3 * ripple_mV * np.sign(np.sin(np.arange(3000) / 7.0))
    assert ranking_of(ripple_V, "voltage_offset", "series_resistance", own_mse=1e-4).something_new == new


def test_an_absolute_size_is_the_least_that_a_perfect_model_names(drop: Ranking) -> None:
    assert replace(drop, own_V=0.0, bias_V=0.0).least_V == 3e-4
    assert replace(drop, own_V=0.0, bias_V=0.0, size_V=2.9e-4).significant is False


def test_significance_asks_for_news_for_size_and_for_more_than_chance(drop: Ranking) -> None:
    assert not replace(drop, something_new=False).significant
    assert not replace(drop, beyond_chance=False).significant
    assert not replace(drop, size_V=0.99 * drop.least_V).significant
    assert replace(drop, size_V=1.01 * drop.least_V).significant


def test_most_of_what_is_new_has_to_be_explained_unless_it_stands_out(drop: Ranking) -> None:
    part = replace(drop, share_of_new=0.4, stands_out=False)
    assert not part.explained and part.unknown
    assert replace(part, stands_out=True).explained
    assert replace(part, share_of_new=0.6).explained
    # Half again as much as the model's own error is not yet something that has to be named.
    assert not replace(part, ratio=1.4).unknown


def test_a_smaller_form_is_named_before_a_larger_one_that_contains_it() -> None:
    found = ranking_of(0.004 * CURRENT_A, "soc_dependence", "series_resistance")
    assert found.candidates[0].effect.name == "series_resistance"
    assert "soc_dependence" not in found.rivals


def test_a_general_form_that_explains_no_more_is_no_rival_of_its_special_case() -> None:
    found = ranking_of(0.02 * CURRENT_A, "series_resistance", "charge_transfer")
    assert found.candidates[0].effect.name == "series_resistance"
    assert found.rivals == ()


def test_a_leak_and_an_offset_of_the_sensor_are_rivals_whatever_the_figures_say() -> None:
    seconds = np.arange(3000)
    drift_V = -SLOPE_V * 0.04 * seconds / 3600.0 / CAPACITY_AH
    for resistive_V in (0.0, -0.04 * RESISTANCE_OHM):
        found = ranking_of(drift_V + resistive_V, "current_offset", "self_discharge", "series_resistance")
        assert {found.candidates[0].effect.name, *found.rivals} == {"current_offset", "self_discharge"}
        # Of two that are one and the same in a log, the margin says nothing.
        assert found.margin > 1.0


def test_two_that_leave_the_same_are_rivals() -> None:
    """Constant current in one direction: a drop and an offset are the same."""
    current = np.full(1500, -1.0)
    run = true_run(current, soc=0.5, added_V=-0.01, noise_V=NOISE_V)
    comparison = compared(run, ["voltage_offset", "series_resistance"], own_mse=NOISE_V**2, noise_mse=NOISE_V**2)
    found = ranked(comparison)
    assert len(found.rivals) == 1
    assert abs(found.margin) < 1.0


def test_a_loop_is_named_for_what_it_explains_in_blocks_that_were_held_out() -> None:
    loop_V = 0.01 * hysteresis_state(CURRENT_A, 30.0, 1.0, CAPACITY_AH)
    found = ranking_of(loop_V, "hysteresis", "voltage_offset", "series_resistance")
    assert found.candidates[0].effect.name == "hysteresis"
    assert found.held_out_share > 0.9 and found.beyond_chance


def test_a_dearer_effect_has_to_explain_more() -> None:
    """The price of a parameter is the logarithm of the number of samples, in units of the noise."""
    run = true_run(CURRENT_A, added_V=0.004 * CURRENT_A, noise_V=NOISE_V, seed=5)
    comparison = compared(run, ["series_resistance", "voltage_offset"], own_mse=NOISE_V**2, noise_mse=NOISE_V**2)
    found = ranked(comparison)
    assert found.price == pytest.approx(np.log(3000.0) * noise_V2(comparison, found.candidates[0]))
    # Where the model's own error is systematic, half a percent of the error is asked for instead.
    coarse = ranking_of(0.02 * CURRENT_A, "series_resistance", "voltage_offset", own_mse=100.0 * NOISE_V**2)
    cost = float(np.sum((0.02 * CURRENT_A) ** 2)) + 3000.0 * NOISE_V**2
    assert coarse.price == pytest.approx(0.005 * cost * 0.99, rel=0.05)
