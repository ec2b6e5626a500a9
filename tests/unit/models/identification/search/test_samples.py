import numpy as np
import pytest

from models.data.resampling import to_grid
from models.identification.search.samples import SampleBank
from models.identification.shared_poles import filtered, moments, output_coefficients
from models.network.folds import N_FOLDS
from models.network.partition import initial_partition
from models.network.regression import CellContext, SignalBank, build_dataset, find_scaling
from models.network.structure import Structure, full_structure
from tests.unit.models import synthetic

CELL = CellContext(synthetic.CAPACITY_AH)


def bank_and_exact(structure: Structure, poles_s: tuple[float, ...]):
    runs = [to_grid(synthetic.run(3000, seed=s, noise_V=1e-3), 1.0) for s in (1, 2)]
    soc = [0.6, 0.6]
    data = build_dataset(structure, find_scaling(structure, runs, soc, CELL), runs, soc, CELL)
    a = output_coefficients(poles_s, 1.0)
    partition = initial_partition(structure.axes)
    return SignalBank(runs, soc, CELL), data, partition, a, moments(partition, data, a, data.groups())


@pytest.mark.parametrize("poles_s", [(), (20.0,), (3.0, 20.0)])
def test_with_every_sample_kept_the_sums_are_exact(poles_s: tuple[float, ...]) -> None:
    structure = full_structure(1.0, len(poles_s), 2, 300.0)
    bank, data, partition, a, exact = bank_and_exact(structure, poles_s)
    kept = SampleBank(bank, 1).take(structure, poles_s)
    found = kept.moments(partition)
    for fold in range(N_FOLDS):
        np.testing.assert_allclose(found.xx[fold], exact.xx[fold::N_FOLDS].sum(axis=0), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.xy[fold], exact.xy[fold::N_FOLDS].sum(axis=0), rtol=1e-9, atol=1e-9)
    assert found.yy.sum() == pytest.approx(exact.yy.sum())
    assert found.count.sum() == exact.count.sum()
    inputs, target = filtered(data, a)
    known = ~np.isnan(target)
    np.testing.assert_allclose(kept.inputs[known], inputs[known], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(kept.target[known], target[known], rtol=1e-12)


@pytest.mark.parametrize("poles_s", [(), (20.0,), (3.0, 20.0)])
def test_few_samples_tell_nearly_the_same(poles_s: tuple[float, ...]) -> None:
    structure = full_structure(1.0, len(poles_s), 2, 300.0)
    bank, _, partition, _, exact = bank_and_exact(structure, poles_s)
    kept = SampleBank(bank, 4).take(structure, poles_s)
    found = kept.moments(partition)
    assert found.count.sum() == pytest.approx(exact.count.sum() / 4, abs=5)
    mean, all_mean = found.xx.sum(axis=0) / found.count.sum(), exact.xx.sum(axis=0) / exact.count.sum()
    assert np.linalg.norm(mean - all_mean) < 0.02 * np.linalg.norm(all_mean)
    # The samples before a change of direction carry the filters across, but do not count.
    assert (len(kept.target) > found.count.sum() + 2) == bool(poles_s)
