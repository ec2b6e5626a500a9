"""Flags of a sample: one bit for each thing that is wrong with it."""

import math
from dataclasses import replace

import pytest

from bench_service.bench.quality import sample_flags
from bench_service.bench.safety import Track
from bench_service.streams import Flag
from drivers.cycler import Reading

GOOD = Reading(1.0, 7, 3.7, 1.0, 25.0, 24.0, 1.0, True, frozenset({"output_on"}), frozenset())


def flags(reading: Reading = GOOD, track: Track | None = None, **context: bool) -> int:
    return sample_flags(reading, track or Track(), **{"settling": False, "gap": False, "suspect": False} | context)


def test_a_good_sample_has_none() -> None:
    assert flags() == 0


def test_unverified_hardware_marks_every_sample() -> None:
    assert flags(unverified=True) == Flag.UNVERIFIED == 512


@pytest.mark.parametrize(
    ("change", "flag"),
    [
        ({"voltage_V": math.nan}, Flag.VOLTAGE_MISSING),
        ({"current_A": math.nan}, Flag.CURRENT_MISSING),
        ({"temperature_degC": math.nan}, Flag.TEMPERATURE_MISSING),
        ({"status": frozenset({"current_limited"})}, Flag.DEVICE_CURRENT_LIMIT),
    ],
)
def test_what_the_device_says(change: dict, flag: Flag) -> None:
    assert flags(replace(GOOD, **change)) == flag


@pytest.mark.parametrize(
    ("track", "flag"),
    [(Track(stale=1), Flag.STALE), (Track(mismatched=1), Flag.SUSPECT), (Track(doubtful=True), Flag.SUSPECT)],
)
def test_what_was_seen_before(track: Track, flag: Flag) -> None:
    assert flags(track=track) == flag


@pytest.mark.parametrize(
    ("name", "flag"), [("settling", Flag.SETTLING), ("gap", Flag.GAP_BEFORE), ("suspect", Flag.SUSPECT)]
)
def test_what_the_loop_knows(name: str, flag: Flag) -> None:
    assert flags(**{name: True}) == flag


def test_several_add_up() -> None:
    wrong = replace(GOOD, voltage_V=math.nan)
    assert flags(wrong, Track(stale=2), gap=True) == Flag.VOLTAGE_MISSING | Flag.STALE | Flag.GAP_BEFORE
