"""Figures of an estimated state of charge."""

import numpy as np
import pytest

from models.observer.tuning.accuracy import soc_figures

TIME_S = np.arange(100.0) + 5.0
STD = np.full(100, 0.01)


def test_figures_count_from_convergence_on() -> None:
    error = np.where(np.arange(100) < 40, 0.2, 0.01)
    error[50] = 0.025
    figures = soc_figures(TIME_S, 0.5 + error, STD, np.full(100, 0.5))
    assert figures["converged_after_s"] == 40.0
    assert figures["soc_rmse"] == pytest.approx(np.sqrt((59 * 0.01**2 + 0.025**2) / 60))
    assert figures["soc_max_error"] == pytest.approx(0.025)
    assert figures["soc_end_error"] == pytest.approx(0.01)
    assert figures["coverage_95"] == pytest.approx(59 / 60)


def test_an_estimate_that_leaves_again_has_not_converged() -> None:
    error = np.zeros(100)
    error[-1] = -0.04
    figures = soc_figures(TIME_S, 0.5 + error, STD, np.full(100, 0.5))
    assert figures["converged_after_s"] is None
    assert figures["soc_rmse"] == pytest.approx(0.004)
    assert figures["soc_max_error"] == pytest.approx(0.04)
    assert figures["soc_end_error"] == pytest.approx(-0.04)


def test_good_from_the_start() -> None:
    assert soc_figures(TIME_S, np.full(100, 0.51), STD, np.full(100, 0.5))["converged_after_s"] == 0.0


def test_missing_references_do_not_count() -> None:
    reference = np.full(100, np.nan)
    reference[60:] = 0.5
    figures = soc_figures(TIME_S, np.full(100, 0.5), STD, reference)
    assert figures["converged_after_s"] == 60.0
    assert figures["soc_rmse"] == 0.0


@pytest.mark.parametrize("reference", [None, np.full(100, np.nan)])
def test_without_reference_everything_is_unknown(reference: np.ndarray | None) -> None:
    assert set(soc_figures(TIME_S, np.full(100, 0.5), STD, reference).values()) == {None}
