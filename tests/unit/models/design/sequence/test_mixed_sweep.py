"""A mixed sweep goes through its whole window, in pieces whose load does not depend on its seed."""

from dataclasses import replace

import numpy as np
import pytest

from models.design.constraints.limitation import LimitationRatio
from models.design.constraints.limits import Limits
from models.design.sequence.excitation_sequence import ExcitationSequence
from models.design.sequence.mixed_sweep import mixed_sweep
from models.design.sequence.sequence_plan import SequencePlan

WINDOW, LIMITS_A, CAPACITY_AH, DT_S = (0.15, 0.9), (-4.0, 2.0), 2.0, 2.0


def plan(**changes: object) -> SequencePlan:
    fields: dict[str, object] = {
        "limits": Limits(LIMITS_A, WINDOW),
        "capacity_Ah": CAPACITY_AH,
        "initial_soc": 0.5,
        "dt_s": DT_S,
        "soc_levels": (0.3, 0.5, 0.7),
        "block_s": DT_S,
        "longest_s": 100.0,
        "ends": WINDOW,
        "end_rest_s": 400.0,
    }
    return SequencePlan(**(fields | changes))  # type: ignore[arg-type]


def swept(duration_s: float = 14_000.0, seed: int = 3, **changes: object) -> ExcitationSequence:
    found = mixed_sweep(plan(**changes), duration_s, seed)
    assert found is not None
    return found


def soc_of(found: ExcitationSequence, start: float = 0.5) -> np.ndarray:
    return start + np.cumsum(found.current_A) * DT_S / 3600.0 / CAPACITY_AH


@pytest.mark.parametrize("start", [0.15, 0.5, 0.9])
@pytest.mark.parametrize("duration_s", [11_000.0, 14_000.0, 60_000.0])
def test_both_ends_are_reached_within_the_time_and_the_currents(start: float, duration_s: float) -> None:
    found = swept(duration_s, initial_soc=start)
    soc = soc_of(found, start)
    assert soc.min() < WINDOW[0] + 1e-3 and soc.max() > WINDOW[1] - 1e-3
    # What swings beyond is moved into the window with the other limits.
    assert soc.min() > WINDOW[0] - 0.05 and soc.max() < WINDOW[1] + 0.05
    assert found.duration_s == pytest.approx(duration_s)
    # Full pulses, and never more.
    assert found.current_A.min() == LIMITS_A[0] and found.current_A.max() == LIMITS_A[1]
    assert np.flatnonzero(found.current_A)[-1] > 0.9 * len(found.current_A)


def test_the_cell_rests_at_each_end() -> None:
    found = swept()
    for end in WINDOW:
        there = np.abs(soc_of(found) - end) < 1e-6
        assert (found.current_A[there] == 0.0).sum() * DT_S >= 400.0


def test_the_seed_decides_about_the_random_parts_only() -> None:
    one, two = swept(seed=3), swept(seed=4)
    np.testing.assert_array_equal(one.current_A, swept(seed=3).current_A)
    assert not np.array_equal(one.current_A, two.current_A)
    assert [block.first for block in one.blocks] == [block.first for block in two.blocks]
    means = [[found.current_A[b.first : b.last].mean() for b in found.blocks] for found in (one, two)]
    np.testing.assert_allclose(means[0], means[1], atol=1e-6)
    sizes = [np.abs(found.current_A).mean() for found in (one, two)]
    assert sizes[0] == pytest.approx(sizes[1], rel=0.05)


def test_the_pieces_differ_in_speed_and_size() -> None:
    pieces = [swept().current_A[block.first : block.last] for block in swept().blocks]
    speeds = np.abs([piece.mean() for piece in pieces[4:12]])
    assert speeds.max() > 1.8 * speeds.min()
    spreads = np.array([np.ptp(piece) for piece in pieces])
    assert spreads.max() > 3.0 * spreads.min()


def test_what_the_voltage_leaves_bounds_the_pieces_and_the_end_is_still_reached() -> None:
    ratio = LimitationRatio(np.array([0.15, 0.7, 0.8, 0.9]), np.ones(4), np.array([1.0, 1.0, 0.3, 0.3]))
    found = swept(20_000.0, ratio=ratio)
    assert soc_of(found).max() == pytest.approx(WINDOW[1], abs=1e-3)
    for block in found.blocks:
        soc = soc_of(found)[block.first : block.last]
        if soc.min() > 0.8:
            assert found.current_A[block.first : block.last].max() <= 0.3 * LIMITS_A[1] + 1e-9


def test_less_time_means_fewer_ways_and_then_none() -> None:
    soc = soc_of(swept(8000.0))
    assert soc.argmax() < soc.argmin() and soc[soc.argmin() :].max() < 0.3
    assert mixed_sweep(plan(), 5000.0, 0) is None
    assert mixed_sweep(replace(plan(), ends=None), 14_000.0, 0) is None
