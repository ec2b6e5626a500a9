"""Groups of samples that are held out together."""

import numpy as np

from models.data.resampling import GridRun
from models.network.folds import N_FOLDS, balanced_groups, folds, group_numbers
from tests.unit.models.hand_network import grid_run


def _run(level_A: float, temperature_degC: float) -> GridRun:
    return grid_run(np.full(50, level_A), temperature_degC)


def test_every_fold_holds_out_runs_at_every_temperature() -> None:
    runs = [_run(-load, degC) for degC in (25.0, 0.0, -10.0) for load in (3.0, 1.0, 2.0, 5.0, 4.0)]
    group = balanced_groups(runs)
    for fold in folds(len(runs)):
        held = [i for i in range(len(runs)) if group[i] in fold]
        assert sorted(runs[i].temperature_degC[0] for i in held) == [-10.0, 0.0, 25.0]
        assert len({runs[i].current_A[0] for i in held}) == 1


def test_the_order_of_the_runs_does_not_matter() -> None:
    rng = np.random.default_rng(3)
    runs = [_run(-float(load), float(degC)) for load, degC in rng.uniform(1.0, 9.0, (13, 2))]
    order = rng.permutation(13)
    np.testing.assert_array_equal(balanced_groups([runs[i] for i in order]), balanced_groups(runs)[order])


def test_groups_are_numbered_without_gaps() -> None:
    for count in (1, N_FOLDS - 1, N_FOLDS, 2 * N_FOLDS + 3):
        group = balanced_groups([_run(-float(i), 20.0) for i in range(count)])
        assert sorted(group.tolist()) == list(range(count))


def test_runs_without_temperature_are_ordered_by_load() -> None:
    runs = [_run(-load, float("nan")) for load in (2.0, 1.0, 3.0)]
    assert balanced_groups(runs).tolist() == [1, 0, 2]


def test_of_few_runs_each_fold_takes_another_part() -> None:
    """One to six runs: every run is held out as much by each fold, but never the same part of all runs at once."""
    for n_runs in range(1, 7):
        index = np.repeat(np.arange(n_runs), 400)
        group = group_numbers(index, None)
        held = [np.isin(group, fold) for fold in folds(int(group.max()) + 1)]
        np.testing.assert_array_equal(np.sum(held, axis=0), 1)
        if n_runs >= N_FOLDS:
            assert all(len(set(group[index == run].tolist())) == 1 for run in range(n_runs))
            continue
        for fold in held:
            places = [set(np.flatnonzero(fold[index == run]).tolist()) for run in range(n_runs)]
            assert all(len(each) == 80 for each in places)
            assert n_runs == 1 or not places[0].intersection(*places[1:])
