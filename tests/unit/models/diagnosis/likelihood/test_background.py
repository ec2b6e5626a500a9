"""Evidence by the marginal likelihood of a Gaussian, against what is written down in full."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from models.diagnosis.likelihood.background import Background, log_sum
from models.diagnosis.likelihood.pairs import pair_gains
from models.diagnosis.likelihood.thresholds import THRESHOLDS

N = 12
RNG = np.random.default_rng(7)
ERROR = RNG.standard_normal(N)
FIXED = np.diag(RNG.uniform(0.5, 1.5, N))
ELSEWHERE = np.exp(-np.abs(np.subtract.outer(np.arange(N), np.arange(N))) / 3.0)
COLUMNS = RNG.standard_normal((N, 2))
BACK = Background(ERROR, FIXED, ELSEWHERE)


def written_out(columns: np.ndarray | None, moved: np.ndarray | float = 0.0) -> float:
    """Logarithm of the mixture, each part by the density of the whole covariance."""
    logs = []
    nothing = tuple(zip(THRESHOLDS.scales, THRESHOLDS.scale_weights, strict=True))
    for scale, weight in nothing if columns is None else THRESHOLDS.effect_scales:
        whole = FIXED + scale**2 * ELSEWHERE
        sizes = (0.0,) if columns is None else THRESHOLDS.sizes
        for size in sizes:
            part = whole if columns is None else whole + size**2 * columns @ columns.T
            logs.append(multivariate_normal(np.zeros(N), part).logpdf(ERROR - moved) + np.log(weight / len(sizes)))
    return log_sum(logs)


def test_the_gain_is_the_ratio_of_the_densities() -> None:
    assert BACK.weigh(COLUMNS).log_likelihood == pytest.approx(written_out(COLUMNS) - written_out(None), abs=1e-6)
    moved = 0.3 * np.arange(N)
    found = BACK.weigh(COLUMNS, moved).log_likelihood
    assert found == pytest.approx(written_out(COLUMNS, moved) - written_out(None), abs=1e-6)


def test_a_pair_is_weighed_as_its_columns_together() -> None:
    columns = [COLUMNS[:, :1], COLUMNS[:, 1:], RNG.standard_normal((N, 1))]
    moved: list[np.ndarray | None] = [None, 0.2 * np.arange(N), None]
    found = pair_gains(BACK, columns, moved, [(0, 1), (0, 2)])
    both = BACK.weigh(COLUMNS, moved[1]).log_likelihood
    assert found[0] == pytest.approx(both, abs=1e-6)
    assert found[1] == pytest.approx(BACK.weigh(np.hstack([columns[0], columns[2]])).log_likelihood, abs=1e-6)


def test_sizes_are_found_with_their_spread() -> None:
    sure = Background(COLUMNS @ np.array([1.5, -0.5]), 1e-4 * np.eye(N), 1e-4 * ELSEWHERE)
    found = sure.weigh(COLUMNS)
    np.testing.assert_allclose(found.mean, [1.5, -0.5], atol=0.02)
    assert np.all(np.sqrt(np.diag(found.covariance)) < 0.02)


def test_an_error_far_larger_than_was_learned_is_unknown() -> None:
    assert Background(20.0 * ERROR, FIXED, ELSEWHERE).unknown > 10.0
    assert BACK.unknown < 0.0
