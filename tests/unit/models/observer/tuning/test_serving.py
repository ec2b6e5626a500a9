"""What serves the SoC best: held against the most likely settings, by the band of the SoC itself."""

from dataclasses import replace

import numpy as np

from models.data.resampling import to_grid
from models.observer.filter.settings import ObserverSettings
from models.observer.tuning.calibration import calibrated_band
from models.observer.tuning.serving import judged_noise_V, serving_best, spread_runs
from models.observer.tuning.unseen import Judged
from tests.unit.models.observer.tuning.test_tuning import measured, network

LIKELY = ObserverSettings(
    voltage_std_V=1e-3, quick_error_std_V=2e-3, quick_error_time_s=20.0, slow_error_std_V=1e-4, resistance_std=1e-3
)


def judged(error_V: float, error_s: float) -> list[Judged]:
    runs = [to_grid(measured(seed, 1e-3, error_V, error_s, 3000), 1.0) for seed in (1, 2)]
    return [Judged(network(), run, 0.5) for run in runs]


def test_a_lasting_error_of_the_model_is_waited_for_and_not_followed() -> None:
    """15 mV for ten minutes at 0.7 V per unit of SoC: who believes each sample is off by two points."""
    runs = judged(15e-3, 600.0)
    found = serving_best(runs, LIKELY, 15e-3)
    before, after = calibrated_band(runs, LIKELY), calibrated_band(runs, found)
    assert found.voltage_std_V > LIKELY.voltage_std_V
    assert after.score < 0.5 * before.score
    assert after.soc_rmse < before.soc_rmse


def test_what_is_most_likely_stays_where_nothing_is_clearly_better() -> None:
    runs = judged(1e-6, 20.0)
    likely = replace(LIKELY, quick_error_std_V=2e-5, slow_error_std_V=5e-5)
    found = serving_best(runs, likely, 1e-3)
    assert calibrated_band(runs, found).score <= calibrated_band(runs, likely).score
    assert found.voltage_std_V == likely.voltage_std_V


def test_health_judges_by_noise_halfway_and_with_the_quick_error_that_was_left() -> None:
    assert judged_noise_V(LIKELY, LIKELY) == LIKELY.voltage_std_V
    noisier = replace(LIKELY, voltage_std_V=9e-3)
    np.testing.assert_allclose(judged_noise_V(LIKELY, noisier), 3e-3)
    left = replace(LIKELY, quick_error_std_V=0.0)
    np.testing.assert_allclose(judged_noise_V(LIKELY, left), np.hypot(1e-3, 2e-3))


def test_settings_are_judged_by_each_of_a_few_long_runs_although_they_stand_there_several_times() -> None:
    one, other = (Judged(network(), to_grid(measured(seed, 1e-3, 1e-6, 20.0, 20000), 1.0), 0.5) for seed in (1, 2))
    chosen = spread_runs([one, other] * 4)
    assert 3 <= len(chosen) < 8
    assert all(any(run is each for run in chosen) for each in (one, other))
