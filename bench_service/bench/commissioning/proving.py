"""The proofs on the device, each harmless by itself: without current first, then with as little as tells something."""

import math
from collections.abc import AsyncIterator, Awaitable
from dataclasses import replace

from bench_service.bench.admission import RefusedError
from bench_service.bench.commissioning.check import Check
from bench_service.bench.commissioning.playing import Played, Stand, play
from bench_service.bench.commissioning.pulses import PulseRow, judge_cell, judge_resistor, judge_sign, steps_of
from bench_service.bench.limits import Limits
from bench_service.bench.plausibility import band_of
from bench_service.bench.rest import bring_to_rest
from bench_service.bench.run_setup import tolerance_A
from drivers.cycler import (
    CyclerConnectionError,
    CyclerError,
    CyclerTimeoutError,
    DeviceLimits,
    SetPointRefusedError,
)

_PARTS_READ_BACK = 12  # more than any device has
_C_RATE = 0.2
_SHARE_OF_LIMITS = 0.5
_LEAST_TOLERANCES = 3.0
_BEYOND = 2.0
_UNDER_REST_V, _UNDER_REST_SHARE = 0.05, 0.02
_CLIENT_GONE_S = 2.0  # a simulator in lock-step has no other watchdog
_GRACE_SHARE, _GRACE_S = 0.1, 0.3
_REST_S, _PULSE_S = 0.5, 1.0
_STOP_WITHIN_S = 1.0


def pulse_A(stand: Stand) -> float:
    """Return the size of the pulses: what was asked for, or enough to be seen and little enough to do no harm.

    Raises
    ------
    RefusedError
        It does not fit within the limits.
    """
    low, high = stand.limits.current_A
    least, most = stand.capabilities.current_A
    room_A = min(high, most, math.inf if one_way(stand) else min(-low, -least))
    if stand.order.current_A is not None:
        if not 0.0 < stand.order.current_A <= room_A:
            raise RefusedError(f"pulses of {stand.order.current_A:g} A do not fit; up to {room_A:g} A may flow")
        return stand.order.current_A
    seen_A = _LEAST_TOLERANCES * tolerance_A(stand.settings, stand.capabilities, stand.limits)
    return min(max(_C_RATE * stand.settings.capacity_Ah, seen_A), _SHARE_OF_LIMITS * room_A)


def one_way(stand: Stand) -> bool:
    """Whether current can only be made to charge: a device without a sink, or a resistor."""
    return stand.order.resistor_Ohm is not None or stand.capabilities.current_A[0] >= 0.0


async def prove(stand: Stand, rest_V: float) -> AsyncIterator[Check]:
    """Give the proofs one after the other; the cycler is at rest after each.

    Raises
    ------
    RefusedError
        The pulses do not fit.
    """
    size_A = pulse_A(stand)
    yield await _at_rest_after(stand, "limits", _limits(stand))
    yield await _at_rest_after(stand, "limit_refused", _limit_refused(stand, size_A))
    yield await _at_rest_after(stand, "limit_trips", _limit_trips(stand, rest_V))
    yield await _at_rest_after(stand, "watchdog", _watchdog(stand))
    for check in await _signs(stand, size_A):
        yield check
    yield await _stop(stand, size_A)


async def _at_rest_after(stand: Stand, name: str, proof: Awaitable[Check]) -> Check:
    """Do a proof, bring the device to rest, clear the alarms that the proof has raised."""
    try:
        check = await proof
    except CyclerError as error:
        check = Check(name, "failed", str(error))
    unrested = await bring_to_rest(stand.cycler)
    try:
        await stand.cycler.clear_fault()
    except CyclerError as error:
        unrested = unrested or str(error)
    if unrested is not None:
        return Check(name, "failed", f"afterwards the cycler did not come to rest: {unrested}")
    return check


def _device(limits: Limits, **changes: tuple[float, float]) -> DeviceLimits:
    own = DeviceLimits(limits.voltage_V, limits.current_A, limits.temperature_degC, limits.ramp_A_per_s)
    return replace(own, **changes)


async def _acquire(stand: Stand, limits: DeviceLimits) -> None:
    await stand.cycler.acquire(limits, stand.settings.watchdog_s, stand.period_s)


async def _limits(stand: Stand) -> Check:
    await _acquire(stand, _device(stand.limits))
    for _ in range(_PARTS_READ_BACK):
        if (difference := await stand.cycler.verify()) is not None:
            return Check("limits", "failed", difference)
    if not stand.capabilities.has_device_limits:
        text = "the device does not hold all limits itself (those it has were read back as written); the service does"
        return Check("limits", "absent", text)
    return Check("limits", "passed", "all limits and the watchdog were written and read back")


async def _limit_refused(stand: Stand, size_A: float) -> Check:
    name, beyond_A = "limit_refused", _BEYOND * size_A
    if not stand.capabilities.has_device_limits or beyond_A > stand.capabilities.current_A[1]:
        return Check(name, "absent", "a set-point beyond a limit cannot be shown on this device")
    low = -size_A if stand.capabilities.current_A[0] < 0.0 else stand.limits.current_A[0]
    await _acquire(stand, _device(stand.limits, current_A=(low, size_A)))
    text = f"{beyond_A:g} A with the device's limit at {size_A:g} A and its output off"
    try:
        await stand.cycler.apply(beyond_A)
        reading = await stand.cycler.sample()
    except (CyclerTimeoutError, CyclerConnectionError):
        raise
    except CyclerError as error:
        return Check(name, "passed", f"{text}: refused ({error})")
    if abs(reading.setpoint_in_force_A) <= size_A * 1.001:
        return Check(name, "passed", f"{text}: held at {reading.setpoint_in_force_A:.4g} A")
    return Check(name, "absent", f"{text} was taken without a complaint; only the service watches this limit")


async def _limit_trips(stand: Stand, rest_V: float) -> Check:
    """Set the upper limit of the voltage below what is there and switch on without current: the device must trip."""
    name, (low, _) = "limit_trips", stand.limits.voltage_V
    high = rest_V - max(_UNDER_REST_V, _UNDER_REST_SHARE * rest_V)
    if not stand.capabilities.has_device_limits or high <= max(low, 0.0):
        return Check(name, "absent", "a trip at a limit cannot be shown without harm here")
    try:
        await _acquire(stand, _device(stand.limits, voltage_V=(low, high)))
    except SetPointRefusedError as error:
        return Check(name, "absent", f"the device takes no limit below the present voltage ({error})")
    text = f"upper limit {high:.4g} V with {rest_V:.4g} V there, switched on at 0 A"
    try:
        await stand.cycler.output(True)
        await stand.cycler.apply(0.0)
        await stand.stop.wait(stand.tick_s)
    except (CyclerTimeoutError, CyclerConnectionError):
        raise
    except CyclerError:
        pass  # the trip itself: what the device says of it is read next
    reading = await stand.cycler.sample()
    if not reading.output_on and reading.alarms:
        return Check(name, "passed", f"{text}: tripped ({', '.join(sorted(reading.alarms))})")
    return Check(name, "absent", f"{text}: the device did not trip; only the service watches this limit")


async def _watchdog(stand: Stand) -> Check:
    name, timeout_s = "watchdog", stand.settings.watchdog_s
    if stand.capabilities.watchdog_s is None:
        return Check(name, "absent", "no watchdog in the device; the declared external interlock must be tried by hand")
    await _acquire(stand, _device(stand.limits))
    await stand.cycler.output(True)
    await stand.cycler.apply(0.0)
    reading = await stand.cycler.sample()
    if not reading.output_on:
        why = ", ".join(sorted(reading.alarms)) or "no alarm"
        return Check(name, "failed", f"the output did not stay on at 0 A ({why}): its end by silence cannot be shown")
    timeout_s = max(timeout_s, _CLIENT_GONE_S) if stand.capabilities.lock_step else timeout_s
    silence_s = timeout_s * (1.0 + _GRACE_SHARE) + _GRACE_S
    if await stand.stop.wait(silence_s):
        return Check(name, "failed", "stopped before the silence was over")
    reading = await stand.cycler.sample()
    values = {"timeout_s": timeout_s, "silence_s": silence_s}
    if reading.output_on:
        text = f"after {silence_s:.2f} s without a message the output was still on; its time-out is {timeout_s:g} s"
        return Check(name, "failed", f"{text}: this device must not run unattended", values)
    said = f" ({', '.join(sorted(reading.alarms))})" if reading.alarms else ""
    text = f"silent for {silence_s:.2f} s with the output on at 0 A: found off{said}; its time-out is {timeout_s:g} s"
    return Check(name, "passed", text, values)


async def _signs(stand: Stand, size_A: float) -> list[Check]:
    pulse_s, told_A = max(_PULSE_S, stand.order.settle_s + 0.5), [size_A, -size_A]
    time_s, current_A = [0.0, _REST_S, _REST_S + pulse_s], [0.0, size_A, 0.0]
    if not one_way(stand):
        time_s += [time_s[-1] + pulse_s, time_s[-1] + 2 * pulse_s]
        current_A += [-size_A, 0.0]
        told_A += [-size_A, size_A]
    try:
        played = await play(stand, [*time_s, time_s[-1] + pulse_s], [*current_A, 0.0])
    except RefusedError as error:
        return [Check("sign", "failed", str(error))]
    if played.end.state != "completed":
        return [Check("sign", "failed", str(played.end.reason))]
    steps = steps_of(played.rows, stand.order.settle_s)
    if len(steps) != len(told_A):
        return [Check("sign", "failed", f"{len(steps)} of {len(told_A)} steps of the current were seen")]
    follows = judge_sign(steps, told_A, tolerance_A(stand.settings, stand.capabilities, stand.limits))
    if stand.order.resistor_Ohm is not None:
        return [follows, judge_resistor(steps, stand.order.resistor_Ohm)]
    settings = stand.settings
    band = band_of(settings.capacity_Ah, settings.limits.voltage_V, settings.resistance_Ohm)
    return [follows, judge_cell(steps, band)]


async def _stop(stand: Stand, size_A: float) -> Check:
    told_A = size_A if one_way(stand) else -size_A
    flowing_s = _REST_S + stand.order.settle_s + _PULSE_S

    def flows(row: PulseRow) -> bool:
        return row.time_s >= flowing_s

    try:
        played = await play(stand, [0.0, _REST_S, flowing_s + 10.0], [0.0, told_A, 0.0], flows)
        if stand.capabilities.lock_step:  # its time stands still: the last measurement, with current, would stay
            await play(stand, [0.0, _REST_S], [0.0, 0.0])
    except RefusedError as error:
        return Check("stop", "failed", str(error))
    return _stop_judged(played, told_A)


def _stop_judged(played: Played, told_A: float) -> Check:
    if played.end.state != "stopped" or not played.end.at_rest or played.stopped_s is None:
        return Check("stop", "failed", f"{played.end.state}: {played.end.reason}")
    values = {"seconds": played.stopped_s, "current_A": played.rows[-1].current_A}
    text = f"output off, verified, {1e3 * played.stopped_s:.0f} ms after the order, with {told_A:+.3g} A flowing"
    if played.stopped_s > _STOP_WITHIN_S:
        return Check("stop", "failed", f"{text}; allowed are {_STOP_WITHIN_S:g} s", values)
    return Check("stop", "passed", text, values)
