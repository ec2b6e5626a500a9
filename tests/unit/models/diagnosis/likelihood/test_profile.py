"""An effect of one size is weighed over all its sizes, whatever its likelihood looks like between them."""

import numpy as np
import pytest

from models.data.timeseries import FloatArray
from models.diagnosis.likelihood.background import Background
from models.diagnosis.likelihood.profile import profile
from models.diagnosis.likelihood.shapes import Moving
from models.diagnosis.likelihood.thresholds import THRESHOLDS

N = 80
X = np.linspace(0.0, 1.0, N)
NOISE_V2, ELSEWHERE_V2 = 1e-6 * np.eye(N), 1e-6 * np.exp(-((X[:, None] - X[None, :]) ** 2) / 0.02)


def straight(sizes: FloatArray) -> FloatArray:
    return 0.01 * sizes[0] * np.sin(7.0 * X)


def kinked(sizes: FloatArray) -> FloatArray:
    """As over a curve with knots: what it does near no change says nothing of what it does further out."""
    return 0.01 * sizes[0] * np.sin(7.0 * X) + 0.004 * np.sin(4.0 * (X - sizes[0])) - 0.004 * np.sin(4.0 * X)


def moving(simulate, limits: tuple[float, float] = (-8.0, 8.0)) -> Moving:  # noqa: ANN001
    starts = ((-1.0,), (0.0,), (1.0,))
    return Moving(
        simulate, 1, starts, np.array([[limits[0]], [limits[1]]]), tuple, lambda sizes, _view: simulate(sizes)
    )


def against(true: float, simulate) -> Background:  # noqa: ANN001
    rng = np.random.default_rng(7)
    error_V = simulate(np.array([true])) + np.linalg.cholesky(NOISE_V2 + ELSEWHERE_V2) @ rng.standard_normal(N)
    return Background(error_V, NOISE_V2, ELSEWHERE_V2)


@pytest.mark.parametrize("true", [0.0, 0.4, -2.2])
def test_what_does_not_bend_is_weighed_as_in_closed_form(true: float) -> None:
    back = against(true, straight)
    found, known = profile(back, moving(straight)).weighed, back.weigh(straight(np.ones(1))[:, None])
    assert found.log_likelihood == pytest.approx(known.log_likelihood, abs=0.05)
    assert found.mean == pytest.approx(known.mean, abs=0.01)
    assert found.covariance == pytest.approx(known.covariance, rel=0.05)


@pytest.mark.parametrize("true", [0.37, -0.73, 1.55, 3.3])
def test_a_likelihood_with_many_tops_is_climbed_at_the_highest(true: float) -> None:
    back = against(true, kinked)
    found = profile(back, moving(kinked))
    std = float(np.sqrt(found.weighed.covariance[0, 0]))
    assert std < 0.1 and abs(found.weighed.mean[0] - true) < 3.0 * std + 0.01
    assert abs(found.size - true) < 0.1
    sizes = np.linspace(-8.0, 8.0, 16001)
    logs = []
    for (scale, weight), white in zip(
        THRESHOLDS.effect_scales,
        back.whites(
            back.error[:, None] - np.column_stack([kinked(np.array([each])) for each in sizes]),
            [scale for scale, _ in THRESHOLDS.effect_scales],
        ),
        strict=True,
    ):
        logs.append(np.log(weight) - back.log_root(scale) - 0.5 * np.sum(white**2, axis=0))
    at = np.array(THRESHOLDS.sizes)[:, None]
    prior = np.mean(np.exp(-0.5 * (sizes / at) ** 2) / at, axis=0) / np.sqrt(2.0 * np.pi)
    whole = np.log(np.trapezoid(np.exp(np.logaddexp.reduce(logs, axis=0) - back.nothing) * prior, sizes))
    assert found.weighed.log_likelihood == pytest.approx(whole, abs=0.5)


def test_only_possible_sizes_are_weighed() -> None:
    """What can only grow is not held to have half its sizes where there is none."""
    back = against(1.0, straight)
    both, one = (profile(back, moving(straight, limits)).weighed for limits in ((-8.0, 8.0), (0.0, 8.0)))
    assert one.log_likelihood == pytest.approx(both.log_likelihood + np.log(2.0), abs=0.05)
