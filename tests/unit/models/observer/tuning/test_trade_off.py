"""Convergence against accuracy."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.observer import FuzzyObserver
from models.observer.tuning.trade_off import scaled, trade_off
from tests.unit.models import synthetic


def test_trusting_the_voltage_less_takes_longer(fitted: FuzzyObserver) -> None:
    grid = [to_grid(synthetic.run(2500, seed=seed, noise_V=1e-3), 1.0) for seed in (11, 12)]
    found = trade_off(fitted, grid, (1.0, 300.0))
    assert [each.factor for each in found] == [1.0, 300.0]
    assert found[0].converged_after_s < found[1].converged_after_s
    assert found[0].soc_rmse < 0.01
    assert all(0.0 <= each.coverage_95 <= 1.0 for each in found)


def test_a_factor_of_one_changes_nothing(fitted: FuzzyObserver) -> None:
    assert scaled(fitted.settings, 1.0) == fitted.settings
    assert scaled(fitted.settings, 2.0).slow_error_std_V == 2.0 * fitted.settings.slow_error_std_V


def test_without_a_reference_nothing_can_be_judged(fitted: FuzzyObserver) -> None:
    run = replace(synthetic.run(100, seed=11), soc_ref=None)
    with pytest.raises(ModelError, match="no run has a reference"):
        trade_off(fitted, [to_grid(run, 1.0)])
    unknown = replace(run, soc_ref=np.full(100, np.nan))
    with pytest.raises(ModelError, match="no run has a reference"):
        trade_off(fitted, [to_grid(unknown, 1.0)])
