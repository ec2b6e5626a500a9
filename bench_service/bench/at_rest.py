"""What a bench without a run must look like. Pure: a state and a reading in, a state and what is to be said out.

The output is off, so there is nothing to switch off; a fault is latched where a run must not follow before somebody
has looked. A bench without a cell is no fault: cells are changed.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from bench_service.bench.limits import Limits
from bench_service.bench.plausibility import CellBand, Sample, Watch, observe
from drivers.cycler import Reading

# Heat that comes by itself is told at once, but a warm hand on the sensor is no fault.
HOT_DEGC = 45.0
_LEAST_A = 0.1


@dataclass(frozen=True, slots=True)
class Notice:
    """Something to say; with `latch` the bench is in fault until it is acknowledged."""

    latch: bool
    code: str
    text: str

    @property
    def key(self) -> tuple[bool, str]:
        """What makes it another one than those before."""
        return self.latch, self.code


@dataclass(frozen=True, slots=True)
class AtRest:
    """What is remembered: of the rules, and what holds already."""

    watch: Watch = Watch()
    told: frozenset[tuple[bool, str]] = frozenset()


def unexpected_output(bench: str, reading: Reading) -> str:
    """Return what is said of an output that is on though nothing runs."""
    return (
        f"{bench}: the output was on at {reading.current_A:.4g} A without a run; switched off. "
        "Find out who switched it on, acknowledge"
    )


def look(state: AtRest, bench: str, limits: Limits, band: CellBand, reading: Reading) -> tuple[AtRest, list[Notice]]:
    """Take a reading.

    Returns
    -------
    The state after it, and what holds now and did not at the reading before.
    """
    if reading.output_on:
        notice = Notice(True, "unexpected_output", unexpected_output(bench, reading))
        return AtRest(told=frozenset({notice.key})), [] if notice.key in state.told else [notice]
    sample = Sample(reading.monotonic_s, reading.voltage_V, reading.current_A, reading.temperature_degC)
    watch, finding = observe(state.watch, band, sample, _LEAST_A)
    notices = list(_limits(bench, limits, reading))
    if finding is not None:
        hot = finding.code == "temperature_rate" and finding.stage == "trip" and reading.temperature_degC > HOT_DEGC
        notices.append(Notice(hot, finding.code, f"{bench}, at rest: {finding.text}; {finding.remedy}"))
    told = frozenset(notice.key for notice in notices)
    return AtRest(watch, told), [notice for notice in notices if notice.key not in state.told]


def _limits(bench: str, limits: Limits, reading: Reading) -> Iterator[Notice]:
    low, high = limits.temperature_degC
    temperature, voltage = reading.temperature_degC, reading.voltage_V
    if math.isnan(temperature):
        yield Notice(False, "temperature_missing", f"{bench}, at rest: no temperature; a run would be refused")
    elif not low <= temperature <= high:
        hot = temperature > high
        remedy = "leave the cell alone until it is cool, then acknowledge" if hot else "warm it before a run"
        text = f"temperature {temperature:.4g} degC is outside {low:g} to {high:g} degC"
        yield Notice(hot, "temperature_limit", f"{bench}, at rest: {text}; {remedy}")
    low, high = limits.voltage_V
    if not low <= voltage <= high:
        over = voltage > high
        remedy = "check cell and sense leads, acknowledge" if over else "no cell, or an empty one"
        text = f"voltage {voltage:.4g} V is outside {low:g} to {high:g} V"
        yield Notice(over, "voltage_limit", f"{bench}, at rest: {text}; {remedy}")
    if reading.alarms:
        alarms = ", ".join(sorted(reading.alarms))
        yield Notice(False, "device_alarm", f"{bench}, at rest: the cycler reports {alarms}; acknowledge to clear it")
