"""What is refused before any command reaches a bench."""

from dataclasses import replace

import numpy as np
import pytest

from bench_service.bench.limits import Limits
from bench_service.campaign.admission import admit, narrowed
from bench_service.errors import BadRequestError

LIMITS = Limits((2.5, 4.2), (-6.0, 3.0), (-20.0, 60.0), (0.1, 0.9), None, 7200.0)


def check(time_s: list[float], current_A: list[float], limits: Limits = LIMITS, **other: float):
    return admit(
        np.array(time_s),
        np.array(current_A),
        limits,
        **{"dt_s": 1.0, "tick_s": other.get("dt_s", 1.0), "initial_soc": 0.5, "capacity_Ah": 3.0} | other,
    )


def test_a_profile_at_its_limits_is_admitted() -> None:
    check([0, 1200, 1800, 7200], [1.2, -6.0, 0.0, 3.0], replace(LIMITS, soc=(0.3, 0.6334)))


@pytest.mark.parametrize(
    ("current_A", "row"),
    [([3.0, 3.01, 0.0], 1), ([-6.01, 0.0, 0.0], 0), ([0.0, 0.0, 9e4], 2)],
)
def test_current_beyond_a_limit_names_row_value_and_limit(current_A: list[float], row: int) -> None:
    with pytest.raises(BadRequestError, match=r"limit -6 to 3 A; scale") as refusal:
        check([0, 1, 2], current_A)
    assert refusal.value.where == ("profile", "current_A", row)


@pytest.mark.parametrize(
    ("time_s", "current_A", "message"),
    [
        ([0.0], [0.0], "at least two rows"),
        ([], [], "at least two rows"),
        ([0.0, 1.0], [0.0], "time_s has 2 values, current_A 1"),
        ([0.0, 1.0], [np.nan, 0.0], r"not a finite number at current_A.0: nan"),
        ([0.0, 1.0], [1e300, 0.0], r"implausible at current_A.0: 1e\+300, limit 100000"),
        ([0.0, np.inf], [0.0, 0.0], r"not a finite number at time_s.1: inf"),
        ([1.0, 2.0], [0.0, 0.0], "must start at 0 s"),
        ([0.0, 2.0, 2.0], [0.0, 0.0, 0.0], "time does not rise at time_s.2: 2 s"),
        ([0.0, 2.0, 1.0], [0.0, 0.0, 0.0], "time does not rise at time_s.2: 1 s"),
    ],
)
def test_a_malformed_profile_is_refused(time_s: list[float], current_A: list[float], message: str) -> None:
    with pytest.raises(BadRequestError, match=message):
        check(time_s, current_A)


def test_a_profile_that_is_too_long_is_refused() -> None:
    with pytest.raises(BadRequestError, match="7201 s, limit 7200 s; shorten"):
        check([0, 7201], [0.0, 0.0])


def test_a_profile_shorter_than_a_sample_or_of_too_many_is_refused() -> None:
    with pytest.raises(BadRequestError, match="another period at dt_s: 10 s"):
        check([0, 5], [0.0, 0.0], dt_s=10.0)
    with pytest.raises(BadRequestError, match="another period at dt_s: 1e-05 s"):
        check([0, 7000], [0.0, 0.0], dt_s=1e-5)


def test_charge_is_counted_from_the_initial_state() -> None:
    with pytest.raises(BadRequestError, match=r"leaves the window after 3600 s.*0.933333, limit 0.1 to 0.9") as refusal:
        check([0, 1800, 3600, 3700], [0.0, 2.6, 0.0, 0.0])
    assert refusal.value.where == ("profile", "time_s", 2)
    check([0, 1800, 3600, 3700], [0.0, 2.3, 0.0, 0.0])
    with pytest.raises(BadRequestError, match="after 0 s"):
        check([0, 1], [0.0, 0.0], initial_soc=0.05)


def test_ramp_counts_set_points_of_neighbouring_ticks_from_rest() -> None:
    limits = replace(LIMITS, ramp_A_per_s=1.0)
    check([0, 1, 2, 3], [1.0, 2.0, 1.0, 0.0], limits)
    with pytest.raises(BadRequestError, match=r"current_A.0: 1.5 A/s, limit 1 A/s"):
        check([0, 1], [1.5, 0.0], limits)
    with pytest.raises(BadRequestError, match=r"current_A.1: 2 A/s"):
        check([0, 10, 20], [-1.0, 1.0, 0.0], limits)
    # Of two rows before one tick only the later is ever applied.
    check([0, 1.2, 1.6, 3], [0.0, 3.0, 1.0, 0.0], limits)


def test_ramp_counts_the_ticks_that_are_played_between_two_samples() -> None:
    limits = replace(LIMITS, ramp_A_per_s=1.0)
    check([0, 3, 6, 9], [3.0, 0.0, 3.0, 0.0], limits, dt_s=3.0)
    with pytest.raises(BadRequestError, match=r"current_A.0: 3 A/s, limit 1 A/s"):
        check([0, 3, 6, 9], [3.0, 0.0, 3.0, 0.0], limits, dt_s=3.0, tick_s=1.0)
    with pytest.raises(BadRequestError, match=r"current_A.1: 6 A/s, limit 1 A/s"):
        check([0, 3.5, 5.5, 9], [0.0, 3.0, 0.0, 0.0], limits, dt_s=3.0, tick_s=0.5)


def test_a_run_may_narrow_limits_only() -> None:
    run = narrowed(LIMITS, {"current_A": (-1.0, 1.0), "ramp_A_per_s": 2.0, "soc": None})
    assert run.current_A == (-1.0, 1.0) and run.ramp_A_per_s == 2.0 and run.soc == (0.1, 0.9)
    assert narrowed(LIMITS, None) == LIMITS


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"voltage_V": (2.4, 4.2)}, "voltage_V 2.4 to 4.2 V, the bench allows 2.5 to 4.2"),
        ({"current_A": (-6.0, 3.1)}, "current_A"),
        ({"temperature_degC": (-21.0, 60.0)}, "temperature_degC"),
        ({"soc": (0.0, 0.9)}, "soc"),
        ({"duration_s": 7201.0}, "duration"),
        ({"ramp_A_per_s": 3.0}, "ramp"),
        ({"voltage_V": (4.0, 3.0)}, "low must be below high"),
    ],
)
def test_a_wider_limit_is_refused(wanted: dict, message: str) -> None:
    with pytest.raises(BadRequestError, match=message):
        narrowed(replace(LIMITS, ramp_A_per_s=2.0), wanted)
