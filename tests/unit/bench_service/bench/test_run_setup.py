from dataclasses import replace

import numpy as np
import pytest

from bench_service.bench.limits import Limits
from bench_service.bench.request import RunRequest
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
