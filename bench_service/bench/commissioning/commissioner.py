"""A commissioning in the control process, from the order to the report."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from statistics import fmean

from bench_service.bench.admission import RefusedError
from bench_service.bench.commissioning.check import Check, ProofOrder, Report, failed
from bench_service.bench.commissioning.playing import Stand
from bench_service.bench.commissioning.probing import alarms, judge, read_at_rest, tick_s
from bench_service.bench.commissioning.proving import prove
from bench_service.bench.latch import Latch
from bench_service.bench.limits import Limits
from bench_service.bench.live import LiveFeed
from bench_service.bench.rest import bring_to_rest
from bench_service.bench.settings import BenchSettings
from bench_service.bench.stop import StopSignal
from drivers.cycler import Capabilities, Cycler, CyclerError, Reading

# A device that is asked for no current still measures some noise around zero.
_BELOW_ZERO_SHARE = 0.01
_RESISTOR_FACTOR = 2.0  # what the rules of a run take for usual; the proof itself is held against what is stated

Notify = Callable[[str, str, str], None]


async def commission(
    settings: BenchSettings,
    device: tuple[Cycler, Capabilities],
    order: ProofOrder,
    tools: tuple[LiveFeed, StopSignal, Notify],
) -> Report:
    """Look at a device at rest and, where that is ordered, prove what it does.

    Parameters
    ----------
    settings, order
    device : (Cycler, Capabilities)
        Connected, at rest.
    tools : (LiveFeed, StopSignal, callable)
        Of the control process; the last takes severity, code and text of an event.
    """
    (cycler, capabilities), (feed, stop, notify) = device, tools
    identity = capabilities.identity
    try:
        readings, took_s = await read_at_rest(cycler)
    except CyclerError as error:
        return Report("failed", str(error), (), identity)
    checks = [*judge(readings, capabilities, settings, order), *alarms(readings)]
    if (reason := failed(checks)) is not None:
        return Report("failed", reason, tuple(checks), identity)
    if not order.prove:
        return Report("probed", None, tuple(checks), identity)
    limits = settings.limits if order.resistor_Ohm is None else _of_resistor(settings, readings)
    if (resistor_Ohm := order.resistor_Ohm) is not None:
        settings = replace(settings, resistance_Ohm=(resistor_Ohm / _RESISTOR_FACTOR, resistor_Ohm * _RESISTOR_FACTOR))
    stand = Stand(settings, cycler, capabilities, order, limits, tick_s(took_s, settings), feed, stop, notify)
    return await _proved(stand, fmean(reading.voltage_V for reading in readings), checks)


async def _proved(stand: Stand, rest_V: float, checks: list[Check]) -> Report:
    identity, reason = stand.capabilities.identity, None
    try:
        async for check in prove(stand, rest_V):
            checks.append(check)
            if stand.stop.order is not None:
                return Report("stopped", stand.stop.order.reason, tuple(checks), identity)
            if (reason := failed(checks)) is not None:
                break
    except RefusedError as error:
        return Report("refused", str(error), tuple(checks), identity)
    finally:
        unrested = await bring_to_rest(stand.cycler)
    if unrested is not None:
        text = f"{stand.settings.name}: the cycler did not come to rest after commissioning: {unrested}"
        return Report("failed", text, tuple(checks), identity, _latch(text))
    # What failed with current flowing wants a look before the next run; a fault latches, as in any run.
    latch = None if reason is None else _latch(f"{stand.settings.name}: commissioning failed: {reason}")
    return Report("passed" if reason is None else "failed", reason, tuple(checks), identity, latch)


def _latch(text: str) -> Latch:
    return Latch("commissioning", text)


def _of_resistor(settings: BenchSettings, readings: Sequence[Reading]) -> Limits:
    """Limits with a resistor, which without current is at 0 V, give and take noise, where no cell may be."""
    low, high = 0.0, settings.limits.voltage_V[1]
    # A device that counts its voltage from 0 takes no limit below, and never measures there.
    if any(reading.voltage_V < 0.0 for reading in readings):
        low = -_BELOW_ZERO_SHARE * high
    return replace(settings.limits, voltage_V=(low, high))
