"""Which samples a diagnosis looks at, and what it reads there."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import GridRun
from models.diagnosis.reference.samples import all_samples, visible
from models.effects import effect
from tests.unit.models.diagnosis.hand_reference import SLOPE_V, SOC, reference, steps_A, true_run
from tests.unit.models.hand_network import CAPACITY_AH


def rest(n: int, **changes) -> GridRun:  # noqa: ANN003
    return replace(true_run(np.zeros(n)), **changes)


def test_samples_are_thinned_to_the_limit() -> None:
    runs = [true_run(steps_A(1000)), true_run(steps_A(500))]
    samples = all_samples(reference(), runs, [SOC, SOC], 400)
    assert [view.index.tolist() for view in samples.views] == [list(range(0, 1000, 4)), list(range(0, 500, 4))]


def test_a_sample_without_a_voltage_is_never_looked_at() -> None:
    run = rest(10, measured=np.arange(10) % 2 == 0)
    assert all_samples(reference(), [run], [SOC], 100).views[0].index.tolist() == [0, 2, 4, 6, 8]


def test_blocks_are_quarters_of_an_hour_and_no_two_runs_share_one() -> None:
    runs = [rest(1801), rest(900)]
    blocks = all_samples(reference(), runs, [SOC, SOC], 10_000).blocks
    expected = np.repeat([0, 1, 2, 3], [900, 900, 1, 900])
    np.testing.assert_array_equal(blocks, expected)


def test_a_long_record_has_sixty_blocks_at_most() -> None:
    run = rest(100_000)
    blocks = all_samples(reference(), [run], [SOC], 1000).blocks
    assert blocks.max() + 1 == 60


def test_some_of_the_samples_keep_their_order_and_lose_empty_blocks() -> None:
    samples = all_samples(reference(), [rest(1801), rest(900)], [SOC, SOC], 10_000)
    chosen = samples.blocks != 1
    kept = samples.kept(chosen)
    assert [len(view.index) for view in kept.views] == [901, 900]
    assert kept.views[0].index[899:].tolist() == [899, 1800]
    assert np.unique(kept.blocks).tolist() == [0, 1, 2]


def test_error_and_regressors_stand_one_run_after_the_other() -> None:
    model = reference()
    runs = [true_run(steps_A(50), added_V=1e-3), true_run(steps_A(30), added_V=-2e-3)]
    samples = all_samples(model, runs, [SOC, SOC], 100)
    np.testing.assert_allclose(samples.error_V, [1e-3] * 50 + [-2e-3] * 30, atol=1e-12)
    assert samples.own_regressors(model).shape == (80, model.layout.size)
    np.testing.assert_allclose(
        samples.own_regressors(model) @ model.coefficients + samples.error_V,
        np.concatenate([run.voltage_V for run in runs]),
        atol=1e-12,
    )
    drop = samples.regressors(effect("series_resistance"))
    np.testing.assert_array_equal(drop[:, 0], np.concatenate([run.current_A for run in runs]))


def test_a_wrong_start_shifts_the_voltage_along_the_line() -> None:
    samples = all_samples(reference(), [true_run(steps_A(50))], [SOC], 100)
    np.testing.assert_allclose(samples.shifted(effect("initial_soc"), 0.02), 0.02 * SLOPE_V, atol=1e-9)


def test_what_an_effect_does_not_have_is_not_asked_of_it() -> None:
    samples = all_samples(reference(), [true_run(steps_A(50))], [SOC], 100)
    with pytest.raises(ValueError, match="does not show in the voltage"):
        samples.regressors(effect("heat_transfer"))
    with pytest.raises(ValueError, match="is not simulated again"):
        samples.shifted(effect("series_resistance"), 1.0)


def test_how_far_an_effect_moves_the_soc_out_of_the_known_range() -> None:
    samples = all_samples(reference(), [true_run(np.zeros(4))], [0.85], 100)
    wrong_start = effect("initial_soc")
    # The curve is known from 0.1 to 0.9: 0.85 + 0.15 is 0.1 beyond it.
    np.testing.assert_allclose(samples.beyond(wrong_start, 0.15), np.full((4, 2), [0.1, 0.01]), atol=1e-12)
    assert samples.beyond(wrong_start, 0.02).shape == (4, 0)
    np.testing.assert_allclose(samples.beyond(wrong_start, -0.8), np.full((4, 2), [0.05, 0.0025]), atol=1e-12)
    assert samples.beyond(effect("series_resistance"), 1.0).shape == (4, 0)


def test_an_effect_of_the_temperature_needs_one_that_moves() -> None:
    entropic = effect("entropic_voltage")
    swings = true_run(np.zeros(10), temperature_degC=np.linspace(20.0, 21.6, 10))
    assert visible(entropic, [swings])
    assert not visible(entropic, [true_run(np.zeros(10), temperature_degC=np.linspace(20.0, 21.4, 10))])
    assert not visible(entropic, [replace(swings, temperature_degC=np.full(10, np.nan))])
    # Two chambers show it as well as one that moves.
    cold, warm = (true_run(np.zeros(10), temperature_degC=each) for each in (10.0, 30.0))
    assert visible(entropic, [cold, warm])
    assert visible(effect("voltage_offset"), [cold]) and not visible(effect("heat_transfer"), [swings])


def test_capacity_is_told_from_the_charge_that_has_passed() -> None:
    run = true_run(np.full(361, 2.0))
    samples = all_samples(reference(), [run], [SOC], 1000)
    # 0.2 Ah in: 0.1 of the capacity, and 0.1 / 1.25 of one a quarter larger.
    moved = samples.shifted(effect("capacity"), 0.25)[-1]
    assert moved == pytest.approx(SLOPE_V * (run.charge_Ah[-1] / CAPACITY_AH) * (1.0 / 1.25 - 1.0), rel=1e-6)
