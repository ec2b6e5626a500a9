"""Steps of the wall clock."""

import asyncio
from typing import Any, cast

import pytest

from bench_service.campaign import clock_watch
from bench_service.campaign.clock_watch import ClockWatch
from bench_service.campaign.journal import Journal


class Clocks:
    """A wall clock and one that nobody sets."""

    wall = 1000.0
    steady = 50.0

    def pass_s(self, seconds: float, step: float = 0.0) -> None:
        self.wall += seconds + step
        self.steady += seconds


@pytest.mark.parametrize(("step", "told"), [(0.0, 0.0), (0.1, 0.0), (-3600.0, -3600.0), (0.5, 0.5)])
def test_a_step_is_told_once_and_drift_is_none(step: float, told: float) -> None:
    clocks = Clocks()
    watch = ClockWatch(lambda: clocks.wall, lambda: clocks.steady)
    clocks.pass_s(1.0, 5e-4)
    assert watch.step_s() == 0.0
    clocks.pass_s(1.0, step)
    assert watch.step_s() == pytest.approx(told)
    clocks.pass_s(1.0)
    assert watch.step_s() == 0.0


async def test_a_step_is_an_event(monkeypatch: pytest.MonkeyPatch) -> None:
    clocks, noted = Clocks(), []

    class Notes:
        def note(self, bench: Any, event: Any) -> None:
            noted.append((event["code"], event["text"]))

    monkeypatch.setattr(clock_watch, "_LOOK_S", 0.001)
    watching = asyncio.create_task(ClockWatch(lambda: clocks.wall, lambda: clocks.steady).watch(cast(Journal, Notes())))
    await asyncio.sleep(0)
    clocks.pass_s(1.0, -7200.0)
    while not noted:
        await asyncio.sleep(0.001)
    watching.cancel()
    ((code, text),) = noted
    assert code == "clock_step" and "set back by 7.2e+03 s" in text
