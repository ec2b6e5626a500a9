"""One look at a bench without a run: what is shown, what is switched off, what is let go."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import pytest

from bench_service.bench.idle import IdleWatch
from bench_service.bench.limits import Limits
from bench_service.bench.settings import BenchSettings
from drivers.cycler import CyclerTimeoutError, Reading

LIMITS = Limits((2.5, 4.2), (-5.0, 5.0), (0.0, 45.0), (0.0, 1.0), None, 100.0)
AT_REST = Reading(0.0, 0, 3.7, 0.0, 25.0, 25.0, 0.0, False, frozenset(), frozenset())


@dataclass
class Device:
    """Keeper, cycler and feed in one."""

    reading: Reading = AT_REST
    error: Exception | None = None
    rest_fails: bool = False
    safe_calls: int = 0
    gone: list[str] = field(default_factory=list)
    shown: list[Reading] = field(default_factory=list)
    due: bool = True

    @property
    def cycler(self) -> "Device":
        return self

    async def sample(self) -> Reading:
        if self.error is not None:
            raise self.error
        return self.reading

    async def safe(self) -> None:
        self.safe_calls += 1
        if self.rest_fails:
            raise CyclerTimeoutError("no answer")

    async def disconnect(self, reason: str) -> None:
        self.gone.append(reason)

    def send(self, reading: Reading) -> None:
        self.shown.append(reading)


async def looked(device: Device) -> list[str]:
    made: Any = device
    watch = IdleWatch(BenchSettings("left", "modbus-tcp://h:1", "generic", LIMITS))
    notices = await watch.sample(made, made, lambda reading: replace(reading, ambient_degC=math.nan))
    return [notice.code for notice in notices]


async def test_a_sample_is_shown_with_what_is_around_the_cell_where_that_is_due() -> None:
    device = Device()
    assert await looked(device) == [] and math.isnan(device.shown[0].ambient_degC) and device.safe_calls == 0
    device = Device(due=False)
    assert await looked(device) == [] and device.shown == []


@pytest.mark.parametrize("rest_fails", [False, True])
async def test_an_output_that_is_on_is_switched_off_and_told(rest_fails: bool) -> None:
    device = Device(replace(AT_REST, output_on=True, current_A=1.0), rest_fails=rest_fails)
    assert await looked(device) == ["unexpected_output"]
    assert device.safe_calls == (2 if rest_fails else 1) and device.gone == (["no answer"] if rest_fails else [])


async def test_one_that_does_not_answer_is_let_go() -> None:
    device = Device(error=CyclerTimeoutError("silent"))
    assert await looked(device) == [] and device.gone == ["silent"] and device.shown == []
