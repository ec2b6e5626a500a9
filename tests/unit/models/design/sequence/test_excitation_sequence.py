import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.data.errors import ModelError
from models.design.constraints.limits import InfeasibleError, Limits
from models.design.sequence.excitation_sequence import build_sequence, estimated_duration_s, fitted_to
from models.design.sequence.sequence_plan import SequencePlan

CAPACITY_AH, DT_S = 2.0, 1.0


def plan(**changes: object) -> SequencePlan:
    fields: dict[str, object] = {
        "limits": Limits((-4.0, 2.0), (0.1, 0.9)),
        "capacity_Ah": CAPACITY_AH,
        "initial_soc": 0.5,
        "dt_s": DT_S,
        "soc_levels": (0.2, 0.5, 0.8),
        "block_s": 120.0,
        "longest_s": 100.0,
    }
    return SequencePlan(**(fields | changes))  # type: ignore[arg-type]


def drifting(soc: float, number: int, change: float) -> np.ndarray:
    """A block that carries the charge away, each one elsewhere."""
    rng = np.random.default_rng(number)
    current = rng.uniform(-2.0, 2.0, 120) + rng.uniform(-0.5, 0.5)
    return np.concatenate([current[:-1], [0.0]])


def soc_path(current: np.ndarray, start: float = 0.5) -> np.ndarray:
    return start + np.concatenate([[0.0], np.cumsum(current)]) * DT_S / 3600.0 / CAPACITY_AH


def test_blocks_begin_at_their_levels_whatever_the_blocks_before_have_carried_away() -> None:
    sequence = build_sequence(plan(), drifting)
    at_start = [block.soc for block in sequence.blocks]
    np.testing.assert_allclose(at_start, [0.8, 0.5, 0.2, 0.5, 0.8, 0.8], atol=1e-9)
    counted = soc_path(sequence.current_A)[[block.first for block in sequence.blocks]]
    np.testing.assert_allclose(counted, at_start, atol=1e-9)


def test_each_level_is_reached_from_above_on_the_way_down_and_from_below_on_the_way_up() -> None:
    sequence = build_sequence(plan(), drifting)
    for block, direction in zip(sequence.blocks, [-1, -1, -1, 1, 1, 1], strict=True):
        before = sequence.current_A[: block.first]
        assert np.sign(before[before != 0.0][-1]) == direction


@pytest.mark.parametrize("levels", [(0.2, 0.5, 0.8), (0.2, 0.4, 0.6, 0.8)])
def test_every_second_block_is_gentle_and_no_level_but_the_turning_point_both_times(levels: tuple[float, ...]) -> None:
    wanted = plan(soc_levels=levels, gentle_share=0.5, block_s=60.0)
    visits = wanted.visits()[:-1]
    shares = {level: [] for level in levels}
    for number, level in enumerate(visits):
        shares[level].append(wanted.share_of(number))
    assert all(sorted(both) == [0.5, 1.0] for level, both in shares.items() if level != levels[0])
    assert [wanted.share_of(number) for number in range(len(levels))] == [1.0, 0.5, 1.0, 0.5][: len(levels)]
    full = plan(soc_levels=levels, block_s=60.0)
    for number in range(len(visits)):
        carried, usual = (abs(each.carried_soc(number, 0.5)) for each in (wanted, full))
        assert carried <= wanted.share_of(number) * full.carry_share * 4.0 * 60.0 / 3600.0 / CAPACITY_AH + 1e-12
        assert carried <= usual


def test_pulses_before_and_after_are_followed_by_rests_of_their_ratio() -> None:
    wanted = plan()
    sequence = build_sequence(wanted, drifting)
    rest = round(8.0 * wanted.pulse_s)
    assert wanted.pulse_s == 20.0
    for block in sequence.blocks:
        assert (sequence.current_A[block.first - rest : block.first] == 0.0).all()
        pulse = sequence.current_A[block.last + 1 : block.last + 21]
        assert (np.abs(pulse) > 0.0).all() and np.ptp(pulse) < 1e-12
        assert (sequence.current_A[block.last + 21 : block.last + 21 + rest] == 0.0).all()


def test_blocks_carry_the_charge_on_towards_the_next_level() -> None:
    wanted = plan(block_s=3600.0)
    # From 0.8 down to 0.5 with pulses of 20 s at 4 A and at 3.2 A on the way.
    assert wanted.carried_soc(0, 0.8) == pytest.approx(-0.3 + (4.0 + 3.2) * 20.0 / 7200.0)
    assert plan().carried_soc(0, 0.8) == pytest.approx(-0.2 * 4.0 * 120.0 / 7200.0)
    assert wanted.carried_soc(4, 0.8) == wanted.carried_soc(5, 0.8) == 0.0
    shorter = estimated_duration_s(wanted) - len(wanted.visits()) * 3600.0
    assert shorter < estimated_duration_s(plan(block_s=1.0)) - 1000.0


def test_the_last_block_repeats_the_one_before() -> None:
    sequence = build_sequence(plan(), drifting)
    again = sequence.blocks[-1]
    assert again.repeats == 4
    first = sequence.blocks[again.repeats]
    np.testing.assert_array_equal(
        sequence.current_A[again.first : again.last], sequence.current_A[first.first : first.last]
    )
    assert all(block.repeats is None for block in build_sequence(plan(repeat=False), drifting).blocks)


def test_the_history_is_cleared_first() -> None:
    conditioned = build_sequence(plan(), drifting).current_A
    assert conditioned[:80].any() and abs(conditioned[:80].sum()) < 0.6 * np.abs(conditioned[:80]).sum()
    # A longer conditioning than none, by pulses and a rest.
    bare = build_sequence(plan(conditioning=False), drifting).current_A
    assert abs(bare[0]) == pytest.approx(1.6, rel=0.02)


def test_duration_and_charge_are_known_before_the_start() -> None:
    wanted = plan()
    per_A = DT_S / 3600.0 / CAPACITY_AH
    sequence = build_sequence(wanted, lambda soc, number, change: np.full(120, change / (120 * per_A)))
    assert estimated_duration_s(wanted) == sequence.duration_s
    end = soc_path(sequence.current_A)[-1]
    assert sequence.charge_Ah == pytest.approx((end - 0.5) * CAPACITY_AH)
    assert sequence.throughput_Ah == pytest.approx(np.abs(sequence.current_A).sum() / 3600.0)
    profile = sequence.profile()
    assert profile.duration_s == sequence.duration_s
    played = profile.current_A[np.searchsorted(profile.time_s, np.arange(len(sequence.current_A)), side="right") - 1]
    np.testing.assert_array_equal(played, sequence.current_A)


def test_blocks_fill_the_time_that_is_left() -> None:
    fitted = fitted_to(plan(), 12_000.0)
    assert 0.99 * 12_000.0 < estimated_duration_s(fitted) <= 12_000.0
    with pytest.raises(InfeasibleError, match="duration is 600 s.*alone take"):
        fitted_to(plan(), 600.0)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    low=st.floats(0.0, 0.3),
    high=st.floats(0.6, 1.0),
    levels=st.integers(1, 6),
    start=st.floats(0.0, 1.0),
    ramp=st.none() | st.tuples(st.floats(-2.0, -0.05), st.floats(0.05, 2.0)),
)
def test_pulses_and_moves_keep_every_limit(
    seed: int, low: float, high: float, levels: int, start: float, ramp: tuple[float, float] | None
) -> None:
    limits = Limits((-4.0, 2.0), (low, high), ramp_A_per_s=ramp)
    spread = tuple(np.linspace(low + 0.1 * (high - low), high - 0.1 * (high - low), levels)) if levels > 1 else (0.5,)
    begin = low + start * (high - low)
    wanted = plan(limits=limits, soc_levels=spread, initial_soc=begin)
    current = build_sequence(wanted, lambda soc, number, change: np.zeros(120)).current_A
    assert current.min() >= -4.0 - 1e-9 and current.max() <= 2.0 + 1e-9
    soc = soc_path(current, begin)
    assert soc.min() >= low - 1e-9 and soc.max() <= high + 1e-9
    if ramp is not None:
        steps = np.diff(np.concatenate([[0.0], current, [0.0]]))
        assert steps.min() >= ramp[0] - 1e-9 and steps.max() <= ramp[1] + 1e-9


@pytest.mark.parametrize(
    ("changes", "error", "says"),
    [
        ({"soc_levels": (0.05, 0.5)}, InfeasibleError, "soc_levels"),
        ({"soc_levels": (0.5, 0.4)}, ModelError, "rising"),
        ({"initial_soc": 0.95}, InfeasibleError, "start at SoC 0.95"),
        ({"rest_ratio": 3.0}, InfeasibleError, "rest_ratio is 3"),
        ({"block_s": 0.0}, InfeasibleError, "duration"),
    ],
)
def test_contradictions_are_named(changes: dict, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        plan(**changes)
