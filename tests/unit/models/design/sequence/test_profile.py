"""What a bench plays."""

import numpy as np
import pytest

from models.data.errors import ModelError
from models.design.sequence.profile import Profile, final_rest_s


def test_a_value_holds_from_its_time_to_the_next() -> None:
    profile = Profile(np.array([0.0, 3600.0, 5400.0]), np.array([1.0, -2.0, 9.0]))
    assert profile.duration_s == 5400.0
    # 1 Ah in, 1 Ah out; the last row ends it and moves nothing.
    np.testing.assert_allclose(profile.soc(0.5, 4.0), [0.5, 0.75, 0.5])


@pytest.mark.parametrize(
    ("time_s", "current_A"),
    [
        ([0.0], [1.0]),
        ([0.0, 1.0], [1.0]),
        ([1.0, 2.0], [1.0, 0.0]),
        ([0.0, 0.0], [1.0, 0.0]),
        ([0.0, 2.0, 1.0], [1.0, 0.0, 0.0]),
        ([0.0, np.inf], [1.0, 0.0]),
        ([0.0, 1.0], [np.nan, 0.0]),
    ],
)
def test_what_cannot_be_played_is_refused(time_s: list[float], current_A: list[float]) -> None:
    with pytest.raises(ModelError, match="a profile"):
        Profile(np.array(time_s), np.array(current_A))


def test_a_test_ends_in_an_eighth_of_rest_and_half_an_hour_at_most() -> None:
    assert final_rest_s(1000.0) == pytest.approx(120.0)
    assert final_rest_s(15_000.0) == pytest.approx(1800.0)
    assert final_rest_s(1e6) == 1800.0
