import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.data.errors import StructureError
from models.network.partition import Partition, hat_partition, initial_partition
from models.network.structure import InputChannel, PartitionAxis, Structure

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
@settings(deadline=None)  # the first one compiles
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


@pytest.mark.parametrize("kernel", ["gaussian", "uniform", "triangular"])
def test_a_temperature_that_was_not_trained_is_blended_as_at_the_edge(kernel: str) -> None:
    partition = grown(kernel)
    for z, edge in (([0.4, 0.3, -25.0], [0.4, 0.3, 0.0]), ([1.2, 0.9, 3.0], [1.2, 0.9, 1.0])):
        np.testing.assert_array_equal(partition.validity(np.array([z])), partition.validity(np.array([edge])))
    # A state of charge goes on.
    assert not np.array_equal(partition.validity(np.array([[-1.0, 0.3, 0.5]])), partition.validity(np.zeros((1, 3))))


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


def rising(gaps: list[float]) -> np.ndarray:
    return -0.1 + np.cumsum(gaps)


GAPS = st.lists(st.floats(1e-3, 0.3), min_size=2, max_size=12)


@settings(deadline=None)  # the first one compiles
@given(GAPS, st.floats(-2.0, 3.0))
def test_hats_sum_to_one_and_blend_the_two_next_knots(gaps: list[float], z: float) -> None:
    knots = rising(gaps)
    phi = hat_partition(knots).validity(np.array([[z]]))[0]
    assert phi.sum() == 1.0
    assert (phi >= 0.0).all()
    assert np.ptp(np.flatnonzero(phi)) <= 1


@settings(deadline=None)  # the first one compiles
@given(GAPS, st.floats(0.0, 1.0), st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_hats_reproduce_a_straight_line_and_hold_it_beyond(gaps: list[float], at: float, a: float, b: float) -> None:
    knots = rising(gaps)
    partition = hat_partition(knots)
    z = knots[0] + at * (knots[-1] - knots[0])
    points = np.array([[z], [knots[0] - 1.0], [knots[-1] + 1.0]])
    expected = a + b * np.array([z, knots[0], knots[-1]])
    np.testing.assert_allclose(partition.validity(points) @ (a + b * knots), expected, atol=1e-11)


def test_hats_are_an_interpolation_between_uneven_knots() -> None:
    knots, z = np.array([0.0, 0.02, 0.1, 0.5, 0.9, 1.0]), np.linspace(-0.3, 1.3, 200)
    values = np.random.default_rng(3).normal(size=(len(knots), 2))
    blended = hat_partition(knots).validity(z[:, None]) @ values
    for column in range(2):
        np.testing.assert_allclose(blended[:, column], np.interp(z, knots, values[:, column]), atol=1e-14)
    np.testing.assert_array_equal(hat_partition(knots).validity(knots[:, None]), np.eye(len(knots)))


def test_boxes_of_hats_give_their_knots_back() -> None:
    knots = np.array([0.0, 0.02, 0.1, 0.5, 0.9])
    partition = hat_partition(knots)
    np.testing.assert_allclose(partition.centres[:, 0], knots, rtol=0.0, atol=1e-16)
    np.testing.assert_allclose((partition.upper - partition.lower)[:, 0], [0.02, 0.02, 0.08, 0.4, 0.4])
    assert partition.neighbours() == [(0, 1), (1, 2), (2, 3), (3, 4)]


@pytest.mark.parametrize("knots", [[0.5], [0.1, 0.1, 0.4], [0.1, 0.5, 0.3], [0.1, np.nan]])
def test_knots_that_do_not_rise_are_refused(knots: list[float]) -> None:
    with pytest.raises(StructureError, match="knots"):
        hat_partition(np.array(knots))


def test_hats_are_not_split() -> None:
    with pytest.raises(StructureError, match="not split"):
        hat_partition(np.array([0.0, 1.0])).split(0, 0)


@pytest.mark.parametrize(
    ("axes", "order", "says"),
    [
        (("soc", "temperature"), 0, "soc, temperature"),
        (("temperature",), 0, "state of charge"),
        (("soc",), 1, "output order 0"),
    ],
)
def test_hats_lie_along_one_state_of_charge_without_past_outputs(axes: tuple[str, ...], order: int, says: str) -> None:
    with pytest.raises(StructureError, match=says):
        Structure(order, (InputChannel("current"),), tuple(PartitionAxis(name) for name in axes), 1.0, "hat")
