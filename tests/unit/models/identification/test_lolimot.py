import numpy as np
import pytest

from models.data.errors import NotIdentifiableError
from models.identification.lolimot import construct, grow_partitions
from models.network.partition import Partition
from models.network.recursion import one_step_regressors
from models.network.regression import Dataset
from models.network.structure import InputChannel, PartitionAxis, Structure

STRUCTURE = Structure(
    1,
    (InputChannel("soc", delay=1), InputChannel("current")),
    (PartitionAxis("soc", k_sigma=0.5), PartitionAxis("temperature", initial=2, k_sigma=0.6)),
    1.0,
)


def curved(n: int, seed: int = 0) -> Dataset:
    """An output that bends along the first partition variable, and more at its lower end."""
    rng = np.random.default_rng(seed)
    z = rng.random((n, 2))
    u = np.column_stack([z[:, 0], rng.random(n), np.ones(n)])
    y = np.log(0.05 + z[:, 0]) + 0.3 * u[:, 1] * (1.0 + z[:, 1]) + 1e-3 * rng.standard_normal(n)
    return Dataset(u, z, y, np.array([0]), np.zeros(n, dtype=np.int64))


def weighted_least_squares(data: Dataset, partition: Partition) -> np.ndarray:
    """Each local model by itself, without any ridge."""
    phi = one_step_regressors(data, 1)[1:]
    validity = partition.validity(data.z)[1:]
    roots = np.sqrt(validity)
    return np.array(
        [
            np.linalg.lstsq(phi * roots[:, i : i + 1], data.y[1:] * roots[:, i], rcond=None)[0]
            for i in range(partition.n_models)
        ]
    )


@pytest.mark.parametrize("kernel", ["gaussian", "triangular"])
def test_local_models_are_weighted_least_squares(kernel: str) -> None:
    data = curved(4000)
    structure = Structure(1, STRUCTURE.inputs, STRUCTURE.axes, 1.0, kernel)
    *_, last = construct(structure, data, 7)
    np.testing.assert_allclose(last.theta, weighted_least_squares(data, last.partition), atol=2e-3)
    validity = last.partition.validity(data.z)[1:]
    error = data.y[1:] - np.einsum("kp,kp->k", one_step_regressors(data, 1)[1:], validity @ last.theta)
    np.testing.assert_allclose(last.loss, validity.T @ error**2, rtol=1e-9)
    np.testing.assert_allclose(last.samples, validity.sum(axis=0), rtol=1e-9)


def test_boxes_are_finest_where_the_output_bends_most() -> None:
    *_, last = construct(STRUCTURE, curved(4000), 9)
    low = last.partition.centres[:, 0] < 0.25
    widths = (last.partition.upper - last.partition.lower)[:, 0]
    assert widths[low].max() < widths[~low].max() and widths[low].min() <= 0.5 * widths[~low].min()


def test_long_records_decide_on_fewer_samples_and_are_fitted_to_all(monkeypatch: pytest.MonkeyPatch) -> None:
    data = curved(20_000)
    *_, exact = construct(STRUCTURE, data, 10)
    monkeypatch.setattr("models.identification.lolimot._DECIDING", 4000)
    sizes = [fit.partition.n_models for fit in construct(STRUCTURE, data, 10)]
    *_, thinned = construct(STRUCTURE, data, 10)
    assert sizes == list(range(2, 11))
    np.testing.assert_array_equal(thinned.partition.lower, exact.partition.lower)
    np.testing.assert_allclose(thinned.theta, exact.theta, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(thinned.samples, exact.samples)


def test_partitions_alone_are_those_of_the_construction() -> None:
    data = curved(5000)
    sizes = [fit.partition for fit in construct(STRUCTURE, data, 8)]
    phi = one_step_regressors(data, 1)
    alone = list(grow_partitions(STRUCTURE, phi, data.y, data.z, 8))
    for built, grown in zip(sizes, alone, strict=True):
        np.testing.assert_array_equal(grown.lower, built.lower)
        np.testing.assert_array_equal(grown.upper, built.upper)


def test_a_thinned_record_allows_as_many_boxes_as_the_whole_one() -> None:
    data, step = curved(2000), 8
    few = (data.u[::step], data.y[::step], data.z[::step])
    whole = list(grow_partitions(STRUCTURE, data.u, data.y, data.z, 20))[-1]
    assert list(grow_partitions(STRUCTURE, *few, 20))[-1].n_models < whole.n_models
    assert list(grow_partitions(STRUCTURE, *few, 20, weight=step))[-1].n_models == whole.n_models


def test_boxes_without_enough_data_are_not_split() -> None:
    fits = list(construct(STRUCTURE, curved(300), 50))
    assert fits[-1].partition.n_models < 10
    assert fits[-1].samples.min() >= 8.0 * STRUCTURE.n_regressors


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(NotIdentifiableError, match="usable samples for 4 parameters"):
        list(construct(STRUCTURE, curved(6), 4))
