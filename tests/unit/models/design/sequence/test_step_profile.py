import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.data.errors import ModelError
from models.design import Profile, StepProfileRequest, step_profile


def request(**changes: object) -> StepProfileRequest:
    fields: dict[str, object] = {
        "capacity_Ah": 2.5,
        "current_A": (-5.0, 2.5),
        "soc": (0.1, 0.9),
        "initial_soc": 0.5,
        "duration_s": 14_000.0,
        "dt_s": 1.0,
    }
    return StepProfileRequest(**(fields | changes))  # type: ignore[arg-type]


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    low=st.floats(0.0, 0.3),
    width=st.floats(0.4, 0.65),
    c_rate=st.floats(1.1, 4.0),
    start=st.floats(0.0, 1.0),
    dt_s=st.sampled_from([0.1, 0.5, 1.0, 2.0]),
)
def test_no_row_leaves_a_limit(seed: int, low: float, width: float, c_rate: float, start: float, dt_s: float) -> None:
    window = (low, low + width)
    limits = (-2.5 * c_rate, 2.5 * c_rate)
    wanted = request(soc=window, initial_soc=low + start * width, current_A=limits, dt_s=dt_s)
    profile = step_profile(wanted, np.random.default_rng(seed))
    soc = profile.soc(wanted.initial_soc, wanted.capacity_Ah)
    assert soc.min() >= window[0] - 1e-9 and soc.max() <= window[1] + 1e-9
    assert profile.current_A.min() >= limits[0] - 1e-12 and profile.current_A.max() <= limits[1] + 1e-12
    ticks = profile.time_s / dt_s
    np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-6)
    assert profile.duration_s == pytest.approx(wanted.duration_s, rel=0.03)


def test_it_goes_down_and_up_through_the_window() -> None:
    soc = step_profile(request(), np.random.default_rng(1)).soc(0.5, 2.5)
    assert soc.min() < 0.14 and soc.max() > 0.86
    assert soc[-1] > 0.8


def test_the_same_seed_gives_the_same_profile() -> None:
    one, two = (step_profile(request(), np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(one.current_A, two.current_A)
    other = step_profile(request(), np.random.default_rng(5))
    assert not np.array_equal(one.current_A, other.current_A)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"duration_s": 600.0}, "do not suffice"),
        ({"current_A": (1.0, 2.0)}, "0 between"),
        ({"soc": (0.5, 0.52)}, "narrower"),
        ({"initial_soc": 0.95}, "outside the window"),
    ],
)
def test_contradictions_are_named(changes: dict, says: str) -> None:
    with pytest.raises(ModelError, match=says):
        step_profile(request(**changes), np.random.default_rng(0))


def test_a_profile_must_rise_from_zero() -> None:
    with pytest.raises(ModelError, match="start at 0"):
        Profile(np.array([1.0, 2.0]), np.zeros(2))
