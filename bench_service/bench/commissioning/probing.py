"""The first look at a device: who it is, and whether its readings at rest can be true. Nothing is written."""

import asyncio
import math
import time
from collections.abc import Iterator, Sequence
from statistics import fmean

from bench_service.bench.admission import RefusedError, check_watchdog
from bench_service.bench.commissioning.check import Check, Outcome, ProofOrder
from bench_service.bench.run_setup import tolerance_A
from bench_service.bench.settings import BenchSettings
from drivers.cycler import Capabilities, Cycler, Reading

_READINGS = 8
_PAUSE_S = 0.05
# Of a cell that has rested; a scale that is wrong by ten shows, a warm hand does not.
_FROM_AMBIENT_K = 20.0
# Of the device's voltage range: what a resistor without current may show.
_ZERO_SHARE = 0.01
_LOW, _HIGH = 0, 1


async def read_at_rest(cycler: Cycler) -> tuple[list[Reading], float]:
    """Read a few samples; return them and how long one takes in s."""
    readings, took_s = [], 0.0
    for _ in range(_READINGS):
        began_s = time.monotonic()
        readings.append(await cycler.sample())
        took_s = max(took_s, time.monotonic() - began_s)
        await asyncio.sleep(_PAUSE_S)
    return readings, took_s


def judge(
    readings: Sequence[Reading], capabilities: Capabilities, settings: BenchSettings, order: ProofOrder
) -> tuple[Check, ...]:
    """Say what the readings of a device at rest tell."""
    return (
        _identity(capabilities),
        _ranges(capabilities, settings),
        _watchdog(capabilities, settings),
        _alive(readings, capabilities),
        _voltage(readings, capabilities, settings, order),
        _current(readings, capabilities, settings),
        _temperature(readings, capabilities, settings),
    )


def _identity(capabilities: Capabilities) -> Check:
    shown = ", ".join(f"{name} {value}" for name, value in capabilities.identity.items() if value)
    if not capabilities.serial:
        text = "has no serial number in its map: another device of its kind at this address would not be noticed"
        return Check("identity", "absent", f"{capabilities.name} ({shown or 'says nothing of itself'}) {text}")
    return Check("identity", "passed", f"{capabilities.name}: {shown}")


def _ranges(capabilities: Capabilities, settings: BenchSettings) -> Check:
    wrong = []
    for name, unit, (low, high), (least, most) in (
        ("current", "A", settings.limits.current_A, capabilities.current_A),
        ("voltage", "V", settings.limits.voltage_V, capabilities.voltage_V),
    ):
        # A bench that allows more current than the device has is usual; one that allows nothing of it is a mistake.
        if high <= least or low >= most:
            wrong.append(f"{name} {low:g} to {high:g} {unit}, the device has {least:g} to {most:g} {unit}")
    if wrong:
        return Check("ranges", "failed", f"the bench's limits lie outside of the device: {'; '.join(wrong)}")
    low, high = capabilities.current_A
    return Check("ranges", "passed", f"the device has {low:g} to {high:g} A, up to {capabilities.voltage_V[1]:g} V")


def _watchdog(capabilities: Capabilities, settings: BenchSettings) -> Check:
    try:
        check_watchdog(settings, capabilities)
    except RefusedError as error:
        return Check("watchdog_range", "failed", str(error))
    if capabilities.watchdog_s is None:
        text = "the device has no watchdog; an external interlock is declared, which cannot be proved from here"
        return Check("watchdog_range", "absent", text)
    return Check("watchdog_range", "passed", f"the device takes a watchdog of {settings.watchdog_s:g} s")


def _alive(readings: Sequence[Reading], capabilities: Capabilities) -> Check:
    if not capabilities.has_sequence:
        return Check("measuring", "absent", "the device does not count its measurements: stale ones are not noticed")
    if capabilities.lock_step:
        return Check("measuring", "absent", "time stands still in lock-step until a run moves it")
    counts = [reading.sequence for reading in readings]
    fresh = sum(later != earlier for earlier, later in zip(counts, counts[1:], strict=False))
    outcome: Outcome = "passed" if fresh else "failed"
    return Check("measuring", outcome, f"{fresh} of {len(counts) - 1} readings were new measurements")


def _voltage(
    readings: Sequence[Reading], capabilities: Capabilities, settings: BenchSettings, order: ProofOrder
) -> Check:
    value = fmean(reading.voltage_V for reading in readings)
    if order.resistor_Ohm is None:
        low, high = settings.limits.voltage_V
        what = "a cell within the bench's limits"
    else:
        zero_V = _ZERO_SHARE * (capabilities.voltage_V[1] if math.isfinite(capabilities.voltage_V[1]) else 1.0)
        low, high = -zero_V, zero_V
        what = "a resistor without current"
    return _within("voltage", value, "V", (low, high), what)


def _current(readings: Sequence[Reading], capabilities: Capabilities, settings: BenchSettings) -> Check:
    if any(reading.output_on for reading in readings):
        return Check("current", "failed", "the output is on although nothing runs; find out who switched it on")
    allowed_A = tolerance_A(settings, capabilities, settings.limits)
    value = fmean(reading.current_A for reading in readings)
    if capabilities.lock_step and abs(value) > allowed_A:
        text = f"{value:.4g} A are those of the run before: time stands still in lock-step until the next one moves it"
        return Check("current", "absent", text)
    return _within("current", value, "A", (-allowed_A, allowed_A), "no current at rest")


def _temperature(readings: Sequence[Reading], capabilities: Capabilities, settings: BenchSettings) -> Check:
    if not capabilities.has_temperature:
        return Check("temperature", "failed", "no sensor at the cell: its limits cannot be watched, runs are refused")
    value = fmean(reading.temperature_degC for reading in readings)
    ambient = fmean(reading.ambient_degC for reading in readings)
    if math.isfinite(ambient) and math.isfinite(value) and abs(value - ambient) > _FROM_AMBIENT_K:
        text = f"{value:.4g} degC, but ambient is {ambient:.4g} degC: check sensors and scales, or let it cool down"
        return Check("temperature", "failed", text, {"temperature_degC": value, "ambient_degC": ambient})
    return _within("temperature", value, "degC", settings.limits.temperature_degC, "a cell at rest")


def _within(name: str, value: float, unit: str, window: tuple[float, float], what: str) -> Check:
    values = {f"{name}_{unit}": value} if math.isfinite(value) else {}
    if window[_LOW] <= value <= window[_HIGH]:
        return Check(name, "passed", f"{value:.5g} {unit}: {what}", values)
    shown = f"{value:.5g} {unit}" if math.isfinite(value) else "is missing"
    remedy = "check wiring, and scale and sign in the map"
    text = f"{shown}, but {what} shows {window[_LOW]:.4g} to {window[_HIGH]:.4g} {unit}; {remedy}"
    return Check(name, "failed", text, values)


def tick_s(took_s: float, settings: BenchSettings) -> float:
    """Return the period for playing on a link whose sample takes so long."""
    return min(settings.watchdog_s / 3.0, max(0.1, 4.0 * took_s))


def alarms(readings: Sequence[Reading]) -> Iterator[Check]:
    """Name the device's alarms, if it has any."""
    found = sorted({alarm for reading in readings for alarm in reading.alarms})
    if found:
        yield Check("alarms", "failed", f"the device reports {', '.join(found)}; remove the cause, acknowledge")
