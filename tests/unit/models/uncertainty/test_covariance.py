from dataclasses import replace

import numpy as np
import pytest

from benchmarks.parameter_covariance import KINDS, judge
from models.data.resampling import to_grid
from models.identification.lolimot import construct
from models.identification.search.fitted import full_theta
from models.identification.shared_poles import fit, moments, output_coefficients, penalties
from models.network.penalty import Penalty
from models.network.recursion import blend, initial_samples, run_recursion, sensitivity_block
from models.network.regression import CellContext, build_dataset, find_scaling
from models.network.structure import minimal_structure
from models.uncertainty.correlation import ResidualCorrelation
from models.uncertainty.covariance import parameter_covariance
from tests.unit.models import synthetic

CORRELATION = ResidualCorrelation(0.4, np.array([0.35, 0.25]), np.exp(-1.0 / np.array([8.0, 150.0])))


@pytest.fixture(scope="module", params=[(), (20.0,), (3.0, 20.0)])
def problem(request: pytest.FixtureRequest):
    order = len(request.param)
    structure = minimal_structure(1.0, order, 1)
    runs = [to_grid(synthetic.run(700, seed=s, noise_V=1e-3), 1.0) for s in (1, 2)]
    cell = CellContext(synthetic.CAPACITY_AH)
    scaling = find_scaling(structure, runs, [0.6, 0.6], cell)
    data = build_dataset(structure, scaling, runs, [0.6, 0.6], cell)
    data.y[100:120] = np.nan
    *_, local = construct(structure, data, 4)
    a = output_coefficients(request.param, 1.0)
    sums = moments(local.partition, data, a, data.groups())
    fitted = fit(sums, penalties(structure, local.partition, data, a))
    return order, local.partition, data, full_theta(a, fitted.b, local.partition.n_models), fitted.penalty


def dense_covariance(order, partition, data, theta, penalty, level, shared: bool) -> np.ndarray:
    """The same by whole matrices."""
    validity = partition.validity(data.z)
    a, f = blend(theta, order, validity, data)
    y = run_recursion(a, f, data.y, data.starts)
    start = initial_samples(len(data), data.starts, order)
    rows = np.empty((len(data), theta.size))
    sensitivity_block(0, validity, data.u, y, a, start, np.zeros((max(order, 1), theta.size)), rows)
    m, p = theta.shape
    if shared:
        spread = np.zeros((m, p, order + m * (p - order)))
        for i in range(m):
            spread[i, :order, :order] = np.eye(order)
            for j in range(order, p):
                spread[i, j, order + i * (p - order) + j - order] = 1.0
        rows = rows @ spread.reshape(m * p, -1)
    rows[np.isnan(data.y) | (start > 0)] = 0.0
    lag = np.abs(np.subtract.outer(np.arange(len(data)), np.arange(len(data))))
    omega = CORRELATION.at(lag.astype(float)) * np.equal.outer(data.run_index, data.run_index)
    information, meat = rows.T @ rows, (rows * level[:, None]).T @ omega @ (rows * level[:, None])
    whole = np.zeros_like(information)
    whole[-len(penalty) :, -len(penalty) :] = penalty
    whole += 1e-10 * np.trace(information) / len(whole) * np.eye(len(whole))
    inverse = np.linalg.inv(information + whole)
    return inverse @ (meat + np.trace(inverse @ meat) / np.trace(inverse @ information) * whole) @ inverse


def least_here(penalty: np.ndarray) -> list[Penalty]:
    """A penalty that the estimate did not go against."""
    return [Penalty(penalty, np.zeros(len(penalty)))]


def test_blocks_give_what_whole_matrices_give(problem) -> None:
    order, partition, data, theta, penalty = problem
    level = 0.01 * (1.0 + np.linspace(0.0, 1.0, len(data)))
    found = parameter_covariance(
        theta, order, partition, data, level=level, correlation=CORRELATION, penalties=least_here(penalty)
    )
    expected = dense_covariance(order, partition, data, theta, penalty, level, shared=True)
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        found.factor @ found.factor.T / np.outer(size, size), expected / np.outer(size, size), atol=1e-5
    )
    assert found.n_shared == order
    assert found.covariance.shape == (theta.size, theta.size)
    np.testing.assert_array_less(found.data_share, 1.0 + 1e-9)


def test_shared_poles_vary_together(problem) -> None:
    order, partition, data, theta, penalty = problem
    found = parameter_covariance(
        theta,
        order,
        partition,
        data,
        level=np.full(len(data), 0.01),
        correlation=CORRELATION,
        penalties=least_here(penalty),
    )
    if order:
        poles = found.covariance.reshape(*theta.shape, *theta.shape)[:, 0, :, 0]
        np.testing.assert_allclose(poles, poles[0, 0])


def test_a_penalty_that_the_estimate_went_far_against_is_not_taken_for_knowledge(problem) -> None:
    order, partition, data, theta, _ = problem
    size = theta.size
    stds = []
    for away in (0.0, 10.0):
        found = parameter_covariance(
            theta,
            order,
            partition,
            data,
            level=np.full(len(data), 0.01),
            correlation=CORRELATION,
            penalties=[Penalty(1e3 * np.eye(size), np.full(size, away))],
            shared=False,
        )
        assert found.n_shared == 0
        stds.append(np.sqrt(np.diag(found.covariance)))
    assert (stds[1] > 2.0 * stds[0]).mean() > 0.5


@pytest.mark.proof
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind.shared], ids=lambda kind: kind.name)
def test_stated_deviations_hold_where_the_truth_is_itself_a_network(kind) -> None:
    row = judge(kind, cases=8, n_samples=2500)
    # 8 cases of 25 parameters, which hang together within each: the spread of the share is about 3 %.
    assert row["coverage_95"] >= 0.86
    # Nor are they far too wide.
    assert 0.3 <= row["median_distance"] <= 1.6


def test_too_small_a_level_would_be_seen(problem) -> None:
    order, partition, data, theta, penalty = problem
    small, large = (
        parameter_covariance(
            theta,
            order,
            partition,
            replace(data),
            level=np.full(len(data), s),
            correlation=CORRELATION,
            penalties=least_here(penalty),
        ).factor
        for s in (0.01, 0.02)
    )
    np.testing.assert_allclose(np.abs(large), 2.0 * np.abs(small), rtol=1e-5, atol=1e-9 * np.abs(large).max())
