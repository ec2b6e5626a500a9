"""The quality of a sample, as the bits of its column ``flags``."""

import math

from bench_service.bench.safety import Track
from bench_service.streams import Flag
from drivers.cycler import Reading


def sample_flags(
    reading: Reading,
    track: Track,
    *,
    settling: bool,
    gap: bool,
    suspect: bool,
    paused: bool = False,
    unverified: bool = False,
) -> int:
    """Return the flags of a sample.

    Parameters
    ----------
    reading : Reading
    track : Track
        Including this reading.
    settling : bool
        The current has not had its time to reach the set-point.
    gap : bool
        Ticks were missed before it.
    suspect : bool
        A safety rule or the driver objects to it.
    paused : bool
        Somebody holds the run.
    unverified : bool
        The hardware has not been commissioned.
    """
    flags = Flag.UNVERIFIED.value if unverified else 0
    if math.isnan(reading.voltage_V):
        flags |= Flag.VOLTAGE_MISSING.value
    if math.isnan(reading.current_A):
        flags |= Flag.CURRENT_MISSING.value
    if math.isnan(reading.temperature_degC):
        flags |= Flag.TEMPERATURE_MISSING.value
    if track.stale:
        flags |= Flag.STALE.value
    if settling:
        flags |= Flag.SETTLING.value
    if "current_limited" in reading.status:
        flags |= Flag.DEVICE_CURRENT_LIMIT.value
    if paused:
        flags |= Flag.PAUSED.value
    if gap:
        flags |= Flag.GAP_BEFORE.value
    if suspect or track.mismatched or track.doubtful:
        flags |= Flag.SUSPECT.value
    return flags
