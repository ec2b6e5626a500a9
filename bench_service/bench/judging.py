"""What a run's samples are held against beside its limits: what is possible for a cell, and what was set."""

import math
import time
from collections.abc import Callable
from dataclasses import replace

from bench_service.bench.plausibility import Finding, Sample, Watch, band_of, expected, observe
from bench_service.bench.plausibility.throughput import Throughput
from bench_service.bench.run import RunPlan
from bench_service.bench.safety import Context, Trip, implausible, second_master
from drivers.cycler import Cycler, Reading

_VERIFY_PERIOD_S = 1.0  # one part of the device's settings is read back each time


class PlausibilityJudge:
    """Looks at every fresh sample of a run; tells of each kind of doubt once.

    Parameters
    ----------
    plan : RunPlan
    notify : callable
        Takes severity, code and text.
    """

    def __init__(self, plan: RunPlan, notify: Callable[[str, str, str], None]) -> None:
        request = plan.request
        self._band = band_of(request.capacity_Ah, request.limits.voltage_V, plan.rules.resistance_Ohm)
        self._least_A = plan.rules.current_tolerance_A
        self._notify = notify
        self._watch = Watch()
        self._expected, self._outside_s = plan.expected, math.nan
        self._told = set[str]()

    def begin_step(self) -> None:
        """Count charge and energy anew: a step of a protocol has begun.

        What holds for one step does not for many cycles: each of them loses some energy, and a little charge.
        """
        self._watch = replace(self._watch, throughput=Throughput())

    def judge(self, reading: Reading, context: Context) -> Trip | None:
        """Return why the output must go off."""
        if context.track.stale:
            return None
        sample = Sample(context.track.time_s, reading.voltage_V, reading.current_A, reading.temperature_degC)
        self._watch, finding = observe(self._watch, self._band, sample, self._least_A)
        if finding is None or finding.stage == "warn":
            finding = self._against_model(sample, sample.time_s - context.held_s) or finding
        if finding is None:
            return None
        if finding.stage == "trip":
            return implausible(context, finding)
        if finding.code not in self._told:
            self._told.add(finding.code)
            text = f"{context.rules.bench} at {context.now_s:.3f} s: {finding.text}; {finding.remedy}"
            self._notify("warning", finding.code, text)
        return None

    def _against_model(self, sample: Sample, position_s: float) -> Finding | None:
        if self._expected is None or math.isnan(sample.voltage_V):
            return None
        self._outside_s = expected.follow(self._outside_s, self._expected, position_s, sample.voltage_V)
        return expected.judge(self._outside_s, self._expected, position_s, sample.voltage_V)


class SettingsJudge:
    """Has the device's settings read back, a part at a time.

    Parameters
    ----------
    cycler : Cycler
        Acquired.
    """

    def __init__(self, cycler: Cycler) -> None:
        self._cycler = cycler
        self._next_s = time.monotonic() + _VERIFY_PERIOD_S

    async def judge(self, context: Callable[[], Context]) -> Trip | None:
        """Return why the output must go off: somebody else writes to the device."""
        now_s = time.monotonic()
        if now_s < self._next_s:
            return None
        self._next_s = now_s + _VERIFY_PERIOD_S
        difference = await self._cycler.verify()
        return None if difference is None else second_master(context(), difference)
