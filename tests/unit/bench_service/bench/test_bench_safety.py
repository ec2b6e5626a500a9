import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_service.bench.limits import Limits
from bench_service.bench.safety import Context, Rules, Track, Trip, check, check_at_rest, follow
from drivers.cycler import Reading

LIMITS = Limits((2.5, 4.2), (-5.0, 5.0), (0.0, 45.0), (0.1, 0.9), 10.0, 100.0)
RULES = Rules("bench-1", LIMITS, current_tolerance_A=0.1, max_age_s=0.5, tick_s=0.1)
GOOD = Reading(1.0, 7, 3.7, 1.0, 25.0, 24.0, 1.0, True, frozenset({"output_on"}), frozenset())
TRACK = Track(sequence=7, fresh_s=1.0, time_s=1.0, current_A=1.0, interval_s=0.1)
CONTEXT = Context(RULES, TRACK, now_s=1.0, soc=0.5, commanded_A=1.0)

any_float = st.floats(allow_nan=True, allow_infinity=True)


def code(trip: Trip | None) -> str | None:
    return None if trip is None else trip.code


def test_a_good_reading_trips_nothing() -> None:
    assert check(GOOD, CONTEXT) is None


@pytest.mark.parametrize(
    ("change", "expected", "words"),
    [
        ({"voltage_V": 4.21}, "voltage_limit", ["bench-1", "1.000 s", "4.21 V", "2.5 to 4.2 V", "acknowledge"]),
        ({"voltage_V": math.nan}, "voltage_limit", ["voltage is missing"]),
        ({"current_A": -5.2}, "current_limit", ["-5.2 A", "-5 to 5 A"]),
        ({"temperature_degC": 45.5}, "temperature_limit", ["45.5 degC"]),
        ({"temperature_degC": math.nan}, "temperature_limit", ["temperature is missing"]),
        ({"alarms": frozenset({"over_current", "internal"})}, "device_alarm", ["internal, over_current"]),
        ({"output_on": False}, "output_off", ["output is off"]),
    ],
)
def test_readings_that_trip(change: dict, expected: str, words: list[str]) -> None:
    trip = check(replace(GOOD, **change), CONTEXT)
    assert trip is not None and trip.code == expected
    assert all(word in trip.text for word in words), trip.text


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"soc": 0.91}, "soc_limit"),
        ({"soc": math.nan}, "soc_limit"),
        ({"soc": None}, None),
        ({"now_s": 100.3, "track": replace(TRACK, fresh_s=100.3)}, "duration_limit"),
        ({"now_s": math.nan}, "duration_limit"),
        ({"now_s": 1.6}, "reading_too_old"),
        ({"track": replace(TRACK, stale=2)}, None),
        ({"track": replace(TRACK, stale=3)}, "stale_readings"),
        ({"track": replace(TRACK, mismatched=2)}, None),
        ({"track": replace(TRACK, mismatched=3)}, "current_mismatch"),
        ({"track": replace(TRACK, change_A=1.1)}, None),
        ({"track": replace(TRACK, change_A=-1.3)}, "ramp_limit"),
    ],
)
def test_contexts_that_trip(change: dict, expected: str | None) -> None:
    assert code(check(GOOD, replace(CONTEXT, **change))) == expected


def test_values_are_told_before_the_alarm_they_cause() -> None:
    reading = replace(GOOD, voltage_V=4.3, output_on=False, alarms=frozenset({"over_voltage"}))
    assert code(check(reading, CONTEXT)) == "voltage_limit"


def test_at_rest_the_output_may_be_off_but_values_must_be_good() -> None:
    off = replace(GOOD, output_on=False, current_A=0.0)
    context = replace(CONTEXT, commanded_A=0.0)
    assert check_at_rest(off, context) is None
    assert code(check_at_rest(replace(off, voltage_V=2.4), context)) == "voltage_limit"
    assert code(check_at_rest(replace(off, alarms=frozenset({"internal"})), context)) == "device_alarm"


@given(voltage_V=any_float, current_A=any_float, temperature_degC=any_float, soc=any_float)
def test_what_is_not_inside_every_limit_trips(
    voltage_V: float, current_A: float, temperature_degC: float, soc: float
) -> None:
    reading = replace(GOOD, voltage_V=voltage_V, current_A=current_A, temperature_degC=temperature_degC)
    inside = 2.5 <= voltage_V <= 4.2 and abs(current_A) <= 5.11 and 0.0 <= temperature_degC <= 45.0
    inside = inside and 0.095 <= soc <= 0.905
    assert (check(reading, replace(CONTEXT, soc=soc)) is None) == inside


@given(
    st.sampled_from(["voltage_V", "current_A", "temperature_degC"]), st.sampled_from([math.nan, math.inf, -math.inf])
)
def test_no_value_that_is_not_finite_passes(name: str, value: float) -> None:
    assert check(replace(GOOD, **{name: value}), CONTEXT) is not None


@given(st.lists(st.booleans(), max_size=30))
def test_stale_readings_are_counted_in_a_row(fresh: list[bool]) -> None:
    track, sequence, expected = follow(Track(), RULES, replace(GOOD, sequence=0), 0.0, 1.0, True), 0, 0
    for k, is_fresh in enumerate(fresh, 1):
        sequence += is_fresh
        track = follow(track, RULES, replace(GOOD, sequence=sequence), k * 0.1, 1.0, True)
        expected = 0 if is_fresh else expected + 1
        assert track.stale == expected
        assert track.fresh_s == pytest.approx((k - expected) * 0.1)


def test_a_device_without_a_sequence_is_never_stale() -> None:
    rules = replace(RULES, has_sequence=False)
    track = follow(follow(Track(), rules, GOOD, 0.0, 1.0, True), rules, GOOD, 0.1, 1.0, True)
    assert track.stale == 0


@given(st.lists(st.tuples(any_float, st.booleans()), min_size=1, max_size=20))
def test_mismatched_current_is_counted_after_settling(samples: list[tuple[float, bool]]) -> None:
    track, expected = Track(), 0
    for k, (current_A, settled) in enumerate(samples):
        track = follow(track, RULES, replace(GOOD, current_A=current_A), k * 0.1, 1.0, settled)
        good = not settled or abs(current_A - 1.0) <= 0.11
        expected = 0 if good else expected + 1
        assert track.mismatched == expected


@pytest.mark.parametrize(
    ("voltage_V", "current_A", "counted"),
    [
        (4.17, 2.0, 0), (4.17, 1.0, 1),  # short of the voltage: the whole current
        (4.199, 0.7, 0), (4.2, 0.0, 0), (4.201, -0.5, 1),  # held by less, but never by the opposite
        (4.22, 0.0, 0), (4.22, 2.0, 1),  # passed: none
    ],
)  # fmt: skip
def test_a_device_that_holds_a_voltage_gives_less_current_only_there(
    voltage_V: float, current_A: float, counted: int
) -> None:
    for sign in (1.0, -1.0):
        seen = replace(GOOD, voltage_V=4.2 + sign * (voltage_V - 4.2), current_A=sign * current_A)
        assert follow(Track(), RULES, seen, 0.0, sign * 2.0, True, 4.2).mismatched == counted
    held = Track(samples=40, changes=40, repeats=9, voltage_V=4.2, sequence=1)
    seen = replace(GOOD, voltage_V=4.2, sequence=2)
    assert follow(held, RULES, seen, 0.0, 2.0, True, 4.2).repeats == 0
    assert follow(held, RULES, seen, 0.0, 2.0, True).repeats == 10


def follow_all(*readings: Reading, dt_s: float = 0.1) -> list[Track]:
    """Tracks after each of some readings, each with a sequence number of its own."""
    tracks = [Track()]
    for k, reading in enumerate(readings):
        fresh = replace(reading, sequence=k)
        tracks.append(follow(tracks[-1], RULES, fresh, k * dt_s, fresh.setpoint_in_force_A, False))
    return tracks[1:]


def test_a_voltage_that_does_not_answer_to_the_current_is_stuck() -> None:
    swings = [replace(GOOD, current_A=current_A) for current_A in (3.0, -3.0, 3.0, 3.0, -3.0)]
    tracks = follow_all(*swings)
    assert [track.unresponsive for track in tracks] == [0, 1, 2, 2, 3]
    assert code(check(GOOD, replace(CONTEXT, track=replace(TRACK, unresponsive=2)))) is None
    assert code(check(GOOD, replace(CONTEXT, track=replace(TRACK, unresponsive=3)))) == "voltage_stuck"
    swings[2] = replace(swings[2], voltage_V=3.7001)
    assert [track.unresponsive for track in follow_all(*swings)] == [0, 1, 0, 0, 1]


def test_a_noisy_voltage_that_falls_silent_is_stuck() -> None:
    noisy = [replace(GOOD, voltage_V=3.7 + 1e-4 * (k % 3)) for k in range(25)]
    tracks = follow_all(*noisy, *([noisy[-1]] * 10))
    assert [track.doubtful for track in tracks[-11:]] == [False] * 3 + [True] * 8
    trips = [code(check(GOOD, replace(CONTEXT, track=replace(track, fresh_s=1.0)))) for track in tracks[-2:]]
    assert trips == [None, "voltage_stuck"]


def test_a_voltage_that_was_never_noisy_may_stay_the_same() -> None:
    quiet = follow_all(*([replace(GOOD, current_A=0.0)] * 60))
    assert not any(track.doubtful for track in quiet)
    assert code(check(GOOD, replace(CONTEXT, track=replace(quiet[-1], fresh_s=1.0)))) is None


def test_small_changes_of_the_current_prove_nothing() -> None:
    assert follow_all(*(replace(GOOD, current_A=1.0 + 0.5 * (k % 2)) for k in range(9)))[-1].unresponsive == 0


@pytest.mark.parametrize(
    ("dt_s", "change_K", "expected"),
    [(0.1, 5.4, None), (0.1, 5.6, "temperature_jump"), (10.0, 19.0, None), (0.1, -5.6, "temperature_jump")],
)
def test_a_temperature_cannot_jump(dt_s: float, change_K: float, expected: str | None) -> None:
    after = replace(GOOD, temperature_degC=GOOD.temperature_degC + change_K, sequence=1)
    track = follow_all(GOOD, after, dt_s=dt_s)[-1]
    context = replace(CONTEXT, track=track, now_s=track.time_s)
    assert code(check(replace(after, temperature_degC=25.0 + change_K), context)) == expected


@pytest.mark.parametrize(
    "change",
    [
        {"voltage_V": (4.2, 2.5)},
        {"current_A": (math.nan, 1.0)},
        {"soc": (0.5, 0.5)},
        {"ramp_A_per_s": 0.0},
        {"duration_s": math.inf},
    ],
)
def test_limits_that_protect_nothing_are_refused(change: dict) -> None:
    with pytest.raises(ValueError, match=next(iter(change))):
        replace(LIMITS, **change)


def test_limits_may_only_be_narrowed() -> None:
    assert LIMITS.wider_than(LIMITS) is None
    assert replace(LIMITS, soc=(0.2, 0.8), ramp_A_per_s=1.0).wider_than(LIMITS) is None
    assert "voltage_V" in (replace(LIMITS, voltage_V=(2.4, 4.2)).wider_than(LIMITS) or "")
    assert "ramp" in (replace(LIMITS, ramp_A_per_s=None).wider_than(LIMITS) or "")
    assert Limits.from_json(LIMITS.to_json()) == LIMITS
