"""Charge and energy one way count for one step of a protocol, not for all of its cycles."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from bench_service.bench.judging import PlausibilityJudge
from bench_service.bench.limits import Limits
from bench_service.bench.safety import Context, Rules, Track
from drivers.cycler import Reading

LIMITS = Limits((2.5, 4.2), (-5.0, 5.0), (0.0, 60.0), (0.0, 1.0), None, 1e6)
RULES = Rules("b", LIMITS, current_tolerance_A=0.1, max_age_s=5.0, tick_s=1.0)


def judged(*, by_steps: bool) -> list[str | None]:
    """Charge 0.9 of the capacity five times, 4 h apart: each in a step of its own, or all in one."""
    request = SimpleNamespace(capacity_Ah=2.5, limits=LIMITS)
    plan: Any = SimpleNamespace(request=request, rules=RULES, expected=None)
    judge, codes = PlausibilityJudge(plan, lambda *_: None), []
    for k in range(10):
        context = Context(RULES, Track(time_s=3600.0 * k), 3600.0 * k, None, 0.0)
        reading = Reading(0.0, k, 3.7, 0.45 * 2.5, 25.0, 25.0, 0.0, True, frozenset(), frozenset())
        trip = judge.judge(reading, context)
        codes.append(None if trip is None else trip.code)
        if by_steps and k % 2:
            judge.begin_step()
    return codes


@pytest.mark.parametrize(("by_steps", "trips"), [(True, False), (False, True)])
def test_what_has_moved_counts_from_the_beginning_of_a_step(by_steps: bool, trips: bool) -> None:
    assert (judged(by_steps=by_steps).count("charge_moved") > 0) == trips
