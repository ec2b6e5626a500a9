"""The temperature chamber in a commissioning report."""

import math
from dataclasses import replace

import pytest

from bench_service.bench.chamber import keeper as keeper_module
from bench_service.bench.chamber.keeper import ChamberKeeper
from bench_service.bench.chamber.settings import ChamberSettings
from bench_service.bench.commissioning.chamber import with_chamber
from bench_service.bench.commissioning.check import Report
from bench_service.bench.limits import Limits
from bench_service.bench.settings import BenchSettings
from drivers.chamber import ChamberIdentity, ChamberReading

LIMITS = Limits((2, 4), (-1, 1), (0, 45), (0, 1), None, 9.0)
CHAMBER = ChamberSettings("modbus-tcp://h:1", "generic_chamber", (0.0, 50.0))
SAID = {"maker": "m", "model": "x", "serial": "7", "firmware": "1"}
THERE = ChamberReading(0.0, 24.0, 20.0, False, frozenset(), frozenset())


def keeper_of(chamber: ChamberSettings | None, reading: ChamberReading | None) -> ChamberKeeper:
    keeper = ChamberKeeper(
        BenchSettings("left", "modbus-tcp://h:2", "generic", LIMITS, chamber=chamber), lambda *_: None
    )
    keeper.reading, keeper.identity = reading, None if reading is None else ChamberIdentity("box", SAID, (-40, 90))
    if reading is not None:
        keeper._answers.set()
    return keeper


async def test_it_is_named_and_looked_at() -> None:
    report = await with_chamber(Report("passed"), keeper_of(CHAMBER, THERE))
    assert report.state == "passed" and report.to_json()["chamber"] == SAID
    (check,) = report.checks
    assert (check.outcome, check.values) == ("passed", {"ambient_degC": 24.0})
    assert check.text == "box: maker m, model x, serial 7, firmware 1; its air is 24 degC"


@pytest.mark.parametrize(
    ("reading", "told"),
    [
        (None, "does not answer"),
        (replace(THERE, alarms=frozenset({"fan"})), "it reports fan"),
        (replace(THERE, temperature_degC=99.0), "allowed are -5 to 55 degC"),
        (replace(THERE, temperature_degC=math.nan), "allowed are -5 to 55 degC"),
    ],
)
async def test_one_that_cannot_be_right_fails_it(
    reading: ChamberReading | None, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keeper_module, "_READY_S", 0.01)
    report = await with_chamber(Report("passed"), keeper_of(CHAMBER, reading))
    assert report.state == "failed" and told in (report.reason or "")
    other = await with_chamber(Report("failed", "sign: turned"), keeper_of(CHAMBER, reading))
    assert other.reason == "sign: turned" and len(other.checks) == 1


async def test_a_bench_without_one_and_a_report_that_was_refused_are_left_as_they_are() -> None:
    for report, chamber in ((Report("passed"), None), (Report("refused", "busy"), CHAMBER)):
        assert await with_chamber(report, keeper_of(chamber, THERE)) is report and "chamber" not in report.to_json()
