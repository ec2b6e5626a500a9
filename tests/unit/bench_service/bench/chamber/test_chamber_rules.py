"""What ends a run for the chamber's sake, and what does not."""

import math
from dataclasses import asdict, replace

from bench_service.bench.chamber.rules import Known, check, follow
from bench_service.bench.chamber.settings import ChamberSettings
from bench_service.bench.limits import Limits
from bench_service.bench.safety import Context, Rules, Track, Trip
from drivers.chamber import ChamberReading

SETTINGS = ChamberSettings("modbus-tcp://h:1", "generic_chamber", (0.0, 50.0), lost_s=30.0)
RULES = Rules("left", Limits((2, 4), (-1, 1), (-10, 60), (0, 1), None, 9.0), 0.1, 1.0, 0.1)
WARM = ChamberReading(0.0, 35.0, 35.0, True, frozenset({"output_on"}), frozenset())


def judged(known: Known, now_s: float) -> Trip | None:
    return check(known, SETTINGS, Context(RULES, Track(), now_s, None, 0.0))


def looked(*readings: ChamberReading | None, told_degC: float | None = 35.0, dt_s: float = 1.0) -> tuple[Known, float]:
    known, time_s = Known(told_degC=told_degC), 0.0
    for reading in readings:
        time_s += dt_s
        known = follow(known, reading if reading is None else replace(reading), time_s, told_degC)
    return known, time_s


def code(*readings: ChamberReading | None, **more: float | None) -> str | None:
    trip = judged(*looked(*readings, **more))
    return trip and trip.code


def test_a_chamber_that_does_as_it_was_told_ends_nothing() -> None:
    assert code(*[WARM] * 40) is None
    assert code(*[replace(WARM, setpoint_degC=35.05)] * 5) is None
    assert code(*[replace(WARM, on=False, setpoint_degC=20.0)] * 5, told_degC=None) is None


def test_one_that_is_silent_is_borne_for_a_stated_time() -> None:
    assert code(WARM, *[None] * 30) is None
    trip = judged(*looked(WARM, *[None] * 31))
    assert trip is not None and trip.code == "chamber_lost"
    assert trip.text == (
        "left at 32.000 s: the temperature chamber has not answered for 31 s, limit 30 s; output switched off, "
        "check the chamber and its link, acknowledge"
    )
    assert code(WARM, *[None] * 30, WARM, *[None] * 30) is None


def test_the_same_reading_again_is_no_answer() -> None:
    known, time_s = looked(WARM)
    for _ in range(31):
        time_s += 1.0
        known = follow(known, known.reading, time_s, 35.0)
    assert (trip := judged(known, time_s)) is not None and trip.code == "chamber_lost"


def test_a_sensor_that_tells_nothing_is_lost_too() -> None:
    blind = replace(WARM, temperature_degC=math.nan)
    trip = judged(*looked(WARM, *[blind] * 31))
    assert trip is not None and "has told no temperature for 31 s" in trip.text


def test_alarms_limits_and_other_hands_end_the_run() -> None:
    assert code(replace(WARM, alarms=frozenset({"fan"}))) == "chamber_fault"
    assert code(replace(WARM, temperature_degC=54.9)) is None
    assert code(replace(WARM, temperature_degC=55.1)) == "chamber_limit"
    assert code(replace(WARM, temperature_degC=-5.1)) == "chamber_limit"
    other = replace(WARM, setpoint_degC=80.0)
    assert code(WARM, other) is None, "it may be on its way"
    assert code(WARM, other, other) == "chamber_changed"
    off = replace(WARM, on=False)
    trip = judged(*looked(off, off))
    assert trip is not None and "is off, it was told 35 degC" in trip.text
    assert code(off, WARM, off) is None


def test_a_new_order_is_no_change_by_others() -> None:
    known, time_s = looked(WARM)
    known = follow(known, replace(WARM), time_s + 1, 25.0)  # read before it was told
    assert known.changed == 1 and judged(known, time_s + 1) is None
    known = follow(known, replace(WARM, setpoint_degC=25.0), time_s + 2, 25.0)
    assert known.changed == 0


def test_settings_come_back_as_they_went() -> None:
    assert ChamberSettings.from_json(asdict(SETTINGS)) == SETTINGS
    assert ChamberSettings.from_json(None) is None
    assert SETTINGS.window.temperature_degC == (0.0, 50.0) and SETTINGS.air_degC == (-5.0, 55.0)
