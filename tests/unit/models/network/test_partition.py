import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.network.partition import Partition, initial_partition
from models.network.structure import PartitionAxis

AXES = (
    PartitionAxis("soc", k_sigma=0.4),
    PartitionAxis("hysteresis", initial=2, splittable=False, k_sigma=0.25),
    PartitionAxis("temperature", initial=3, splittable=False, k_sigma=0.5),
)


def grown(kernel: str = "gaussian") -> Partition:
    partition = initial_partition(AXES, kernel)
    for model in (0, 3, 1, 6):
        partition = partition.split(model, 0)
    return partition


def test_prepartition_is_two_by_three() -> None:
    assert initial_partition(AXES).n_models == 6


def test_boxes_tile_the_space() -> None:
    partition = grown()
    assert np.prod(partition.upper - partition.lower, axis=1).sum() == pytest.approx(1.0)


@pytest.mark.parametrize("kernel", ["gaussian", "uniform", "triangular"])
@given(st.lists(st.floats(-3.0, 4.0), min_size=3, max_size=3))
def test_validity_sums_to_one_everywhere(kernel: str, z: list[float]) -> None:
    phi = grown(kernel).validity(np.array([z]))
    assert phi.sum() == pytest.approx(1.0, abs=1e-12)
    assert (phi >= 0.0).all()


def test_far_outside_the_outermost_boxes_take_all() -> None:
    partition = grown()
    phi = partition.validity(np.array([[60.0, 1.0, 0.9]]))[0]
    assert phi[partition.upper[:, 0] == 1.0].sum() > 0.999
    assert np.isfinite(phi).all()


def test_gaussian_validity_matches_the_definition() -> None:
    partition = grown()
    z = np.random.default_rng(1).uniform(size=(50, 3))
    exponent = -0.5 * (((z[:, None] - partition.centres) / partition.widths) ** 2).sum(axis=2)
    mu = np.exp(exponent)
    np.testing.assert_allclose(partition.validity(z), mu / mu.sum(axis=1, keepdims=True), rtol=1e-10)


def test_neighbours_share_a_face() -> None:
    partition = initial_partition(AXES)
    # Each of two directions has two temperature borders; each of three temperatures one direction border.
    assert len(partition.neighbours()) == 2 * 2 + 3
