"""The limits of a run as a protocol sees them."""

from dataclasses import replace

from bench_service.bench.limits import Limits, Window
from bench_service.protocol import program


def window_of(
    limits: Limits,
    device_A: Window | None = None,
    *,
    soc_known: bool = True,
    chamber: program.ChamberWindow | None = None,
) -> program.Window:
    """Return what a protocol may not leave: the run's limits, and the device's range of current where that is known.

    Without `chamber` there is no temperature chamber that it could set; one is never set beyond the run's own limits.
    """
    low, high = limits.current_A
    if device_A is not None:
        low, high = max(low, device_A[0]), min(high, device_A[1])
    soc = soc_window(limits) if soc_known else None
    window = program.Window(limits.voltage_V, (low, high), soc, limits.ramp_A_per_s, limits.duration_s)
    if chamber is None:
        return window
    (low, high), (coldest, hottest) = chamber.temperature_degC, limits.temperature_degC
    return replace(window, chamber=replace(chamber, temperature_degC=(max(low, coldest), min(high, hottest))))


def soc_window(limits: Limits) -> Window | None:
    """Return the limits on the counted state of charge; None where the whole range is allowed.

    Whoever allows all of 0 to 1 does not ask for a limit: a capacity that is a percent larger than was thought must
    not end the test that measures it. Its voltage limits hold as ever.
    """
    return None if limits.soc[0] <= 0.0 and limits.soc[1] >= 1.0 else limits.soc
