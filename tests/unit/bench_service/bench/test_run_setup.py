from dataclasses import replace

import numpy as np
import pytest

from bench_service.bench.admission import RefusedError
from bench_service.bench.limits import Limits
from bench_service.bench.request import ProtocolOrder, RunRequest
from bench_service.bench.run_setup import prepare
from bench_service.bench.settings import BenchSettings
from drivers.cycler import Capabilities

DEVICE = Capabilities("device", "1", (-30.0, 30.0), (0.0, 6.0), (0.1, 60.0), False, True, True, True)


@pytest.mark.parametrize(
    ("limit_A", "stated_A", "expected_A"), [(5.0, None, 0.15), (0.5, None, 0.05), (0.05, None, 0.015), (0.05, 0.2, 0.2)]
)
async def test_the_current_may_be_off_by_a_share_of_the_runs_own_limits(
    limit_A: float, stated_A: float | None, expected_A: float
) -> None:
    limits = Limits((2.5, 4.2), (-limit_A, limit_A), (0.0, 45.0), (0.0, 1.0), None, 100.0)
    request = RunRequest("r", 0.1, limits, 2.5, np.array([0.0, 10.0]), np.array([0.01, 0.0]))
    wide = replace(limits, current_A=(-10.0, 10.0))
    settings = BenchSettings("b", "modbus-tcp://127.0.0.1:1", "generic", wide, current_tolerance_A=stated_A)
    prepared = await prepare(settings, DEVICE, request)
    assert prepared.plan.rules.current_tolerance_A == pytest.approx(expected_A)


@pytest.mark.parametrize(
    ("ramp_A_per_s", "time_s", "current_A", "message"),
    [
        (None, [0.0, 0.4, 0.7, 10.0], [1.0, 100.0, 1.0, 0.0], "100 A at 0.666667 s, the run's limits are -5 to 5 A"),
        (2.0, [0.0, 1.0, 2.0, 10.0], [0.0, 2.0, 0.0, 0.0], "changes by 2 A within 0.333333 s"),
        (6.0, [0.0, 1.0, 1.4, 3.0, 10.0], [0.0, -2.0, 2.0, 0.0, 0.0], "changes by 4 A within 0.333333 s at 1.66667 s"),
    ],
)
async def test_what_is_played_between_two_samples_is_checked(
    ramp_A_per_s: float | None, time_s: list[float], current_A: list[float], message: str
) -> None:
    limits = Limits((2.5, 4.2), (-5.0, 5.0), (0.0, 45.0), (0.0, 1.0), ramp_A_per_s, 100.0)
    request = RunRequest("r", 1.0, limits, 2.5, np.array(time_s), np.array(current_A))
    settings = BenchSettings("b", "modbus-tcp://127.0.0.1:1", "generic", limits)
    with pytest.raises(RefusedError, match=message):
        await prepare(settings, DEVICE, request)
    # A simulation in lock-step has no ticks between its samples.
    prepared = await prepare(settings, replace(DEVICE, lock_step=True), request)
    assert prepared.plan.every == 1


@pytest.mark.parametrize(("dt_s", "tick_s"), [(0.1, 0.1), (1.0, 1 / 3), (30.0, 1 / 3)])
async def test_the_queue_holds_a_minute_of_all_that_a_run_may_store(dt_s: float, tick_s: float) -> None:
    limits = Limits((2.5, 4.2), (-5.0, 5.0), (0.0, 45.0), (0.0, 1.0), None, 1000.0)
    settings = BenchSettings("b", "modbus-tcp://127.0.0.1:1", "generic", limits)
    profile = RunRequest("r", dt_s, limits, 2.5, np.array([0.0, 100.0]), np.array([0.01, 0.0]))
    prepared = await prepare(settings, DEVICE, profile)
    assert 60.0 <= prepared.queue_rows * dt_s <= 60.0 + 2 * dt_s
    step = {"step": "constant_current", "rate_C": 0.1, "until": {"time_s": 60}}
    document = {"schema": "bench-protocol-1", "name": "t", "steps": [step], "record": {"time_s": 0.3}}
    order = ProtocolOrder(document=document, standing=None, expected_s=None)
    protocol = replace(profile, time_s=np.empty(0), current_A=np.empty(0), protocol=order)
    assert (await prepare(settings, DEVICE, protocol)).queue_rows * tick_s >= 60.0
