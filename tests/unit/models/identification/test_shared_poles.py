import numpy as np
import pytest

from models.data.resampling import to_grid
from models.identification.lolimot import construct
from models.identification.search.fitted import full_theta
from models.identification.shared_poles import (
    Moments,
    filtered,
    fit,
    moments,
    output_coefficients,
    penalties,
    solve_without,
)
from models.network.folds import folds
from models.network.recursion import free_run
from models.network.regression import CellContext, build_dataset, find_scaling
from models.network.structure import full_structure, minimal_structure
from tests.unit.models import synthetic


@pytest.fixture(scope="module", params=[(), (20.0,), (3.0, 20.0)])
def problem(request: pytest.FixtureRequest):
    poles = request.param
    structure = full_structure(1.0, len(poles), 2, 300.0)
    runs = [to_grid(synthetic.run(1500, seed=s, noise_V=1e-3), 1.0) for s in (1, 2)]
    cell = CellContext(synthetic.CAPACITY_AH)
    scaling = find_scaling(structure, runs, [0.6, 0.6], cell)
    data = build_dataset(structure, scaling, runs, [0.6, 0.6], cell)
    *_, local = construct(structure, data, 8)
    a = output_coefficients(poles, 1.0)
    return structure, data, local.partition, a, moments(local.partition, data, a, data.groups())


def squared_error(theta: np.ndarray, order: int, partition, data, chosen: np.ndarray) -> float:
    error = (data.y - free_run(theta, order, partition.validity(data.z), data))[chosen]
    return float(error @ error)


def test_moments_give_the_free_run_error(problem) -> None:
    structure, data, partition, a, sums = problem
    b = np.random.default_rng(1).normal(size=partition.n_models * data.u.shape[1]) * 0.1
    group = data.groups()
    theta = full_theta(a, b, partition.n_models)
    since = np.concatenate([np.arange(1500), np.arange(1500)])
    for g in range(len(sums.count)):
        expected = squared_error(theta, len(a), partition, data, (group == g) & (since >= len(a)))
        assert sums.yy[g] - 2 * b @ sums.xy[g] + b @ sums.xx[g] @ b == pytest.approx(expected, rel=1e-8)


def test_no_other_parameters_simulate_better(problem) -> None:
    structure, data, partition, a, sums = problem
    b = solve_without(sums, np.zeros_like(sums.xx[0]), np.array([], dtype=int))
    everything = np.ones(len(data), dtype=bool)
    best = squared_error(full_theta(a, b, partition.n_models), len(a), partition, data, everything)
    rng = np.random.default_rng(2)
    for _ in range(5):
        other = b + 1e-3 * rng.normal(size=len(b))
        assert squared_error(full_theta(a, other, partition.n_models), len(a), partition, data, everything) > best


def test_penalties_are_positive_semidefinite_and_vanish_for_equal_models(problem) -> None:
    structure, data, partition, a, _ = problem
    same = np.tile(np.random.default_rng(3).normal(size=data.u.shape[1]), partition.n_models)
    for form in penalties(structure, partition, data, a):
        assert np.linalg.eigvalsh(form).min() > -1e-9
        assert same @ form @ same == pytest.approx(0.0, abs=1e-9)


def test_strengths_are_chosen_on_held_out_groups(problem) -> None:
    structure, data, partition, a, sums = problem
    forms = penalties(structure, partition, data, a)
    chosen = fit(sums, forms)
    assert chosen.held_out_mse < 0.3 * np.nanvar(data.y)
    for level in (-8.0, -6.0, -4.0, -2.0):
        assert chosen.held_out_mse <= 1.01 * held_out_mse(sums, forms, level)


def held_out_mse(sums: Moments, forms: list[np.ndarray], level: float) -> float:
    """Mean squared error with all penalties of one strength, each fold by a fit that did not see it."""
    penalty = 10.0**level * np.sum(forms, axis=0) * sums.count.sum()
    squared = 0.0
    for held in folds(len(sums.count)):
        b = solve_without(sums, penalty, held)
        xx, xy = sums.xx[held].sum(axis=0), sums.xy[held].sum(axis=0)
        squared += sums.yy[held].sum() - 2.0 * b @ xy + b @ xx @ b
    return squared / sums.count.sum()


def test_a_filter_of_the_inputs_is_the_free_run_of_one_local_model() -> None:
    structure = minimal_structure(1.0, 2, 1)
    run = to_grid(synthetic.run(400, seed=3, noise_V=1e-3), 1.0)
    cell = CellContext(synthetic.CAPACITY_AH)
    scaling = find_scaling(structure, [run, run], [0.6, 0.6], cell)
    data = build_dataset(structure, scaling, [run, run], [0.6, 0.6], cell)
    a, b = output_coefficients((3.0, 20.0), 1.0), np.array([0.02, 0.01, -0.01, 0.005])
    inputs, target = filtered(data, a)
    simulated = free_run(full_theta(a, b, 1), 2, np.ones((len(data), 1)), data)
    known = ~np.isnan(target)
    assert known.sum() == len(data) - 4
    np.testing.assert_allclose(data.y[known] - simulated[known], (target - inputs @ b)[known], atol=1e-12)


def test_output_coefficients_have_the_poles_asked_for() -> None:
    a = output_coefficients((3.0, 20.0), 1.0)
    np.testing.assert_allclose(np.sort(np.roots([1.0, *-a])), np.exp([-1 / 3.0, -1 / 20.0]))


def test_every_group_is_held_out_once() -> None:
    held = np.concatenate(folds(10))
    np.testing.assert_array_equal(np.sort(held), np.arange(10))
