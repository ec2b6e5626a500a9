"""Safety rules of a run: what ends it at once. Pure functions of a reading and its context.

Comparisons are written ``not (low <= value <= high)``, so that NaN violates every limit.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

from bench_service.bench.limits import Limits
from drivers.cycler import Reading

# The coulomb counter starts at a stated value and integrates the sensor's offset: half a percent is no violation.
SOC_TOLERANCE = 0.005
# Share of the commanded current by which a calibrated cycler may be off.
CURRENT_GAIN_TOLERANCE = 0.01
MISMATCH_LIMIT = 3
# A voltage that is the same to the last bit although the current has moved by a tenth of the device's range (a usual
# tolerance is half a percent of it) comes from a sensor that is stuck; three times in a row are no chance.
RESPONSE_TOLERANCES = 20
UNRESPONSIVE_LIMIT = 3
# A voltage that is noisy (nine of ten samples differ from the one before) does not stay the same ten times by chance.
LIVELY_SHARE = 0.9
LIVELY_SAMPLES = 20
REPEATS_DOUBTFUL = 3
REPEATS_LIMIT = 10
# No cell's surface moves faster, not even in thermal runaway between two samples of a second; a sensor that has come
# loose or been swapped does.
TEMPERATURE_JUMP_K = 5.0
TEMPERATURE_RATE_K_PER_S = 5.0

Code = Literal[
    "voltage_limit",
    "current_limit",
    "temperature_limit",
    "soc_limit",
    "ramp_limit",
    "duration_limit",
    "reading_too_old",
    "stale_readings",
    "device_alarm",
    "output_off",
    "current_mismatch",
    "voltage_stuck",
    "temperature_jump",
]


@dataclass(frozen=True, slots=True)
class Trip:
    """A violated rule.

    Parameters
    ----------
    code : str
    text : str
        What, where, the value with its unit, the limit, what to do.
    """

    code: Code
    text: str


@dataclass(frozen=True, slots=True)
class Rules:
    """What stays the same during a run.

    Parameters
    ----------
    bench : str
        Name for the messages.
    limits : Limits
    current_tolerance_A : float
        Allowed error of the measured current, without the share of the commanded one.
    max_age_s : float
        Oldest fresh reading on which the output may stay on.
    tick_s : float
        Period of the checks; the run's duration may pass its limit by one.
    stale_limit : int
        Stale readings in a row that end the run.
    has_sequence : bool
        Whether the device counts its measurements; without it staleness cannot be seen.
    """

    bench: str
    limits: Limits
    current_tolerance_A: float
    max_age_s: float
    tick_s: float
    stale_limit: int = 3
    has_sequence: bool = True


@dataclass(frozen=True, slots=True)
class Track:
    """What is remembered from one sample to the next.

    Parameters
    ----------
    sequence : int or None
        Of the last reading.
    fresh_s : float
        Time of the last reading whose sequence had advanced.
    stale : int
        Stale readings in a row.
    mismatched : int
        Samples in a row whose measured current was not the commanded one.
    time_s, current_A : float
        Of this sample.
    interval_s, change_A, change_K : float
        Since the sample before; zero at the first.
    voltage_V, temperature_degC : float
        Of this sample; before the first one the temperature is that at rest, NaN where it is unknown.
    unresponsive : int
        Times in a row that the current moved much and the voltage not at all.
    samples, changes, repeats : int
        Fresh samples so far, how many had a voltage other than the one before, and how often the last one has come
        again.
    doubtful : bool
        Whether the voltage may be stuck: not enough to end the run, enough to mark the sample.
    """

    sequence: int | None = None
    fresh_s: float = 0.0
    stale: int = 0
    mismatched: int = 0
    time_s: float = 0.0
    current_A: float = 0.0
    interval_s: float = 0.0
    change_A: float = 0.0
    change_K: float = 0.0
    voltage_V: float = 0.0
    temperature_degC: float = math.nan
    unresponsive: int = 0
    samples: int = 0
    changes: int = 0
    repeats: int = 0
    doubtful: bool = False

    @property
    def lively(self) -> bool:
        """Whether the voltage was noisy until it began to repeat itself."""
        before = self.samples - self.repeats
        return before >= LIVELY_SAMPLES and self.changes >= LIVELY_SHARE * before


@dataclass(frozen=True, slots=True)
class Context:
    """What a reading is judged against.

    Parameters
    ----------
    rules : Rules
    track : Track
        Including this reading.
    now_s : float
        Time since the run's start.
    soc : float or None
        From counting charge; None where the initial one is unknown.
    commanded_A : float
        Set-point in force before this sample.
    """

    rules: Rules
    track: Track
    now_s: float
    soc: float | None
    commanded_A: float


def follow(track: Track, rules: Rules, reading: Reading, time_s: float, commanded_A: float, settled: bool) -> Track:
    """Return the track after a reading taken at `time_s` with `commanded_A` in force.

    `settled` tells whether the current has had its time to reach the set-point.
    """
    stale = rules.has_sequence and reading.sequence == track.sequence
    allowed_A = rules.current_tolerance_A + CURRENT_GAIN_TOLERANCE * abs(commanded_A)
    follows = not settled or abs(reading.current_A - commanded_A) <= allowed_A
    first = track.sequence is None
    seen = track if stale else _follow_voltage(track, rules, reading)
    return replace(
        seen,
        sequence=reading.sequence,
        fresh_s=track.fresh_s if stale else time_s,
        stale=track.stale + 1 if stale else 0,
        mismatched=0 if follows else track.mismatched + 1,
        time_s=time_s,
        current_A=reading.current_A,
        interval_s=0.0 if first else time_s - track.time_s,
        change_A=0.0 if first else reading.current_A - track.current_A,
        change_K=0.0 if math.isnan(track.temperature_degC) else reading.temperature_degC - track.temperature_degC,
        voltage_V=reading.voltage_V,
        temperature_degC=reading.temperature_degC,
    )


def _follow_voltage(track: Track, rules: Rules, reading: Reading) -> Track:
    """Note whether the voltage of a fresh sample is alive."""
    same = track.sequence is not None and reading.voltage_V == track.voltage_V
    moved_A = abs(reading.current_A - track.current_A) if same else 0.0
    after = replace(
        track,
        samples=track.samples + 1,
        changes=track.changes + (not same),
        repeats=track.repeats + 1 if same else 0,
        unresponsive=track.unresponsive + (moved_A > RESPONSE_TOLERANCES * rules.current_tolerance_A) if same else 0,
    )
    loaded = abs(reading.current_A) > 2 * rules.current_tolerance_A
    unproven = after.samples - after.repeats < LIVELY_SAMPLES and loaded
    dull = after.repeats >= REPEATS_DOUBTFUL and (after.lively or unproven)
    return replace(after, doubtful=dull or (same and (track.doubtful or moved_A > 2 * rules.current_tolerance_A)))


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


def check_at_rest(reading: Reading, context: Context) -> Trip | None:
    """Return why the output must not be switched on at all; None if it may."""
    return _check_values(reading, context) or _check_alarms(reading, context)


def _check_values(reading: Reading, context: Context) -> Trip | None:
    rules, limits = context.rules, context.rules.limits
    low, high = limits.voltage_V
    if not (low <= reading.voltage_V <= high):
        return _out(context, "voltage_limit", "voltage", reading.voltage_V, "V", (low, high))
    low, high = limits.current_A
    allowed_A = rules.current_tolerance_A + CURRENT_GAIN_TOLERANCE * abs(context.commanded_A)
    if not (low - allowed_A <= reading.current_A <= high + allowed_A):
        return _out(context, "current_limit", "current", reading.current_A, "A", (low, high))
    low, high = limits.temperature_degC
    if not (low <= reading.temperature_degC <= high):
        return _out(context, "temperature_limit", "temperature", reading.temperature_degC, "degC", (low, high))
    low, high = limits.soc
    soc = context.soc
    if soc is not None and not (low - SOC_TOLERANCE <= soc <= high + SOC_TOLERANCE):
        return _out(context, "soc_limit", "counted state of charge", soc, "", (low, high))
    if not (context.now_s <= limits.duration_s + rules.tick_s):
        return _trip(
            context,
            "duration_limit",
            f"the run lasts longer than its limit of {limits.duration_s:g} s",
            "shorten the profile or widen the limit",
        )
    return None


def _check_alarms(reading: Reading, context: Context) -> Trip | None:
    if not reading.alarms:
        return None
    alarms = ", ".join(sorted(reading.alarms))
    return _trip(context, "device_alarm", f"the cycler reports {alarms}", "remove the cause, acknowledge")


def _check_output(reading: Reading, context: Context) -> Trip | None:
    if not reading.output_on:
        return _trip(
            context,
            "output_off",
            "the cycler's output is off though the run has it switched on",
            "check the cycler's panel, interlock and watchdog, acknowledge",
        )
    return None


def _check_freshness(reading: Reading, context: Context) -> Trip | None:
    rules, track = context.rules, context.track
    if not (track.stale < rules.stale_limit):
        return _trip(
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
        return _trip(
            context,
            "reading_too_old",
            f"the last fresh reading is {age_s:.3g} s old, limit {rules.max_age_s:.3g} s",
            "check the load of this computer and the cycler's link, acknowledge",
        )
    return None


def _check_current(reading: Reading, context: Context) -> Trip | None:
    rules, track = context.rules, context.track
    if not (track.mismatched < MISMATCH_LIMIT):
        return _trip(
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
            return _trip(
                context,
                "ramp_limit",
                f"current changed by {track.change_A:.4g} A in {track.interval_s:.4g} s, limit {ramp:g} A/s",
                "check the cycler's ramp, acknowledge",
            )
    return None


def _check_sensors(reading: Reading, context: Context) -> Trip | None:
    track = context.track
    if not (track.unresponsive < UNRESPONSIVE_LIMIT) or (track.lively and track.repeats >= REPEATS_LIMIT):
        return _trip(
            context,
            "voltage_stuck",
            f"voltage {reading.voltage_V:.5g} V has come {track.repeats + 1} times to the last bit, in "
            f"{track.unresponsive} changes of the current",
            "check the voltage sensor and its leads, acknowledge",
        )
    allowed_K = TEMPERATURE_JUMP_K + TEMPERATURE_RATE_K_PER_S * track.interval_s
    if not (abs(track.change_K) <= allowed_K):
        return _trip(
            context,
            "temperature_jump",
            f"temperature jumped by {track.change_K:.3g} K in {track.interval_s:.3g} s to "
            f"{reading.temperature_degC:.4g} degC, plausible are {allowed_K:.3g} K",
            "check the temperature sensor, acknowledge",
        )
    return None


def _out(context: Context, code: Code, what: str, value: float, unit: str, window: tuple[float, float]) -> Trip:
    suffix = f" {unit}" if unit else ""
    shown = "is missing" if value != value else f"{value:.5g}{suffix} is outside"
    return _trip(
        context,
        code,
        f"{what} {shown}, limits {window[0]:g} to {window[1]:g}{suffix}",
        "check cell, sensor and limits, acknowledge",
    )


def _trip(context: Context, code: Code, what: str, remedy: str) -> Trip:
    return Trip(code, f"{context.rules.bench} at {context.now_s:.3f} s: {what}; output switched off, {remedy}")
