"""The rules themselves: each returns what is violated, or nothing.

Comparisons are written ``not (low <= value <= high)``, so that NaN violates every limit.
"""

from bench_service.bench.safety.rules import CURRENT_GAIN_TOLERANCE, SOC_TOLERANCE
from bench_service.bench.safety.trip import Context, Trip, outside, trip
from bench_service.durations import in_words
from drivers.cycler import Reading

MISMATCH_LIMIT = 3
# What `Track` counts as unresponsive happens once by chance, and so do a few equal values of a noisy voltage.
UNRESPONSIVE_LIMIT = 3
REPEATS_LIMIT = 10
# No cell's surface moves faster, not even in thermal runaway between two samples of a second; a sensor that has come
# loose or been swapped does.
TEMPERATURE_JUMP_K = 5.0
TEMPERATURE_RATE_K_PER_S = 5.0


def check(reading: Reading, context: Context) -> Trip | None:
    """Return the first violated rule, None if the output may stay on.

    Measured values come first: their messages say more than the alarm that a device raises on the same cause.
    """
    return (
        _check_values(reading, context)
        or _check_alarms(reading, context)
        or _check_output(reading, context)
        or _check_freshness(reading, context)
        or _check_current(reading, context)
        or _check_sensors(reading, context)
    )


def check_held(reading: Reading, context: Context) -> Trip | None:
    """Return the first rule that is violated while somebody holds the run: all but that the output is off."""
    if reading.output_on:
        remedy = "find out who switched it on, acknowledge"
        return trip(context, "output_on", "the cycler's output is on though the run is paused", remedy)
    return _check_values(reading, context) or _check_alarms(reading, context) or _check_freshness(reading, context)


def check_at_rest(reading: Reading, context: Context) -> Trip | None:
    """Return why the output must not be switched on at all; None if it may."""
    return _check_values(reading, context) or _check_alarms(reading, context)


def _check_values(reading: Reading, context: Context) -> Trip | None:
    rules, limits = context.rules, context.rules.limits
    low, high = limits.voltage_V
    if not (low <= reading.voltage_V <= high):
        return outside(context, "voltage_limit", "voltage", reading.voltage_V, "V", (low, high))
    low, high = limits.current_A
    allowed_A = rules.current_tolerance_A + CURRENT_GAIN_TOLERANCE * abs(context.commanded_A)
    if not (low - allowed_A <= reading.current_A <= high + allowed_A):
        return outside(context, "current_limit", "current", reading.current_A, "A", (low, high))
    low, high = limits.temperature_degC
    if not (low <= reading.temperature_degC <= high):
        return outside(context, "temperature_limit", "temperature", reading.temperature_degC, "degC", (low, high))
    low, high = limits.soc
    soc = context.soc
    if soc is not None and not (low - SOC_TOLERANCE <= soc <= high + SOC_TOLERANCE):
        return outside(context, "soc_limit", "counted state of charge", soc, "", (low, high))
    if not (context.now_s - context.held_s <= limits.duration_s + rules.tick_s):
        return trip(
            context,
            "duration_limit",
            f"the run lasts longer than its limit of {in_words(limits.duration_s)}",
            "shorten the profile or widen the limit",
        )
    return None


def _check_alarms(reading: Reading, context: Context) -> Trip | None:
    if not reading.alarms:
        return None
    alarms = ", ".join(sorted(reading.alarms))
    return trip(context, "device_alarm", f"the cycler reports {alarms}", "remove the cause, acknowledge")


def _check_output(reading: Reading, context: Context) -> Trip | None:
    if not reading.output_on:
        return trip(
            context,
            "output_off",
            "the cycler's output is off though the run has it switched on",
            "check the cycler's panel, interlock and watchdog, acknowledge",
        )
    if context.track.remote_seen and "remote" not in reading.status:
        return trip(
            context,
            "remote_lost",
            "the cycler is no longer in remote control",
            "find out who took it over at its panel or over another link, acknowledge",
        )
    return None


def _check_freshness(reading: Reading, context: Context) -> Trip | None:
    rules, track = context.rules, context.track
    if not (track.stale < rules.stale_limit):
        return trip(
            context,
            "stale_readings",
            f"{track.stale} readings in a row with the same sequence number {reading.sequence}, "
            f"limit {rules.stale_limit}",
            "the cycler has stopped measuring; check it, acknowledge",
        )
    return check_age(context)


def check_age(context: Context) -> Trip | None:
    """Return why the last fresh reading is no ground for a command any more; None if it is one."""
    rules = context.rules
    age_s = context.now_s - context.track.fresh_s
    if not (age_s <= rules.max_age_s):
        return trip(
            context,
            "reading_too_old",
            f"the last fresh reading is {age_s:.3g} s old, limit {rules.max_age_s:.3g} s",
            "check the load of this computer and the cycler's link, acknowledge",
        )
    return None


def _check_current(reading: Reading, context: Context) -> Trip | None:
    rules, track = context.rules, context.track
    if not (track.mismatched < MISMATCH_LIMIT):
        return trip(
            context,
            "current_mismatch",
            f"current {reading.current_A:.4g} A is not the commanded {context.commanded_A:.4g} A "
            f"for {track.mismatched} samples, tolerance {rules.current_tolerance_A:.3g} A plus 1 %"
            + (", and the cycler reports a limit of its own" if "current_limited" in reading.status else ""),
            "check wiring, sense leads and the cycler's limits, acknowledge",
        )
    ramp = rules.limits.ramp_A_per_s
    if ramp is not None:
        # Both samples carry an error of their own.
        allowed_A = ramp * track.interval_s + 2 * (
            rules.current_tolerance_A + CURRENT_GAIN_TOLERANCE * abs(context.commanded_A)
        )
        if not (abs(track.change_A) <= allowed_A):
            return trip(
                context,
                "ramp_limit",
                f"current changed by {track.change_A:.4g} A in {track.interval_s:.4g} s, limit {ramp:g} A/s",
                "check the cycler's ramp, acknowledge",
            )
    return None


def _check_sensors(reading: Reading, context: Context) -> Trip | None:
    track = context.track
    if not (track.unresponsive < UNRESPONSIVE_LIMIT) or (track.lively and track.repeats >= REPEATS_LIMIT):
        return trip(
            context,
            "voltage_stuck",
            f"voltage {reading.voltage_V:.5g} V has come {track.repeats + 1} times to the last bit, in "
            f"{track.unresponsive} changes of the current",
            "check the voltage sensor and its leads, acknowledge",
        )
    allowed_K = TEMPERATURE_JUMP_K + TEMPERATURE_RATE_K_PER_S * track.interval_s
    if not (abs(track.change_K) <= allowed_K):
        return trip(
            context,
            "temperature_jump",
            f"temperature jumped by {track.change_K:.3g} K in {track.interval_s:.3g} s to "
            f"{reading.temperature_degC:.4g} degC, plausible are {allowed_K:.3g} K",
            "check the temperature sensor, acknowledge",
        )
    return None
