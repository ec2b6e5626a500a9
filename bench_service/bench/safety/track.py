"""What is remembered of a run from one sample to the next."""

import math
from dataclasses import dataclass, replace

from bench_service.bench.safety.rules import CURRENT_GAIN_TOLERANCE, Rules
from drivers.cycler import Reading

# A device that holds a voltage has it within so much.
HELD_WITHIN_V = 0.01
# A voltage that is the same to the last bit although the current has moved by a tenth of the device's range (a usual
# tolerance is half a percent of it) comes from a sensor that is stuck; three times in a row are no chance.
RESPONSE_TOLERANCES = 20
# A voltage that is noisy (nine of ten samples differ from the one before) does not stay the same ten times by chance.
LIVELY_SHARE = 0.9
LIVELY_SAMPLES = 20
REPEATS_DOUBTFUL = 3
# After a step of the current the voltage moves by more than its noise for so long: already the same value once is
# doubtful then.
MOVING_S = 2.0


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
    stepped_s : float
        Time of the last step of the current.
    remote_seen : bool
        Whether the device has said in this run that it is remote-controlled.
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
    stepped_s: float = -math.inf
    remote_seen: bool = False

    @property
    def lively(self) -> bool:
        """Whether the voltage was noisy until it began to repeat itself."""
        before = self.samples - self.repeats
        return before >= LIVELY_SAMPLES and self.changes >= LIVELY_SHARE * before


def follow(
    track: Track,
    rules: Rules,
    reading: Reading,
    time_s: float,
    commanded_A: float,
    settled: bool,
    hold_V: float | None = None,
) -> Track:
    """Return the track after a reading taken at `time_s` with `commanded_A` in force.

    `settled` tells whether the current has had its time to reach the set-point; `hold_V` is the voltage that the device
    itself holds by less current.
    """
    stale = rules.has_sequence and reading.sequence == track.sequence
    allowed_A = rules.current_tolerance_A + CURRENT_GAIN_TOLERANCE * abs(commanded_A)
    follows = not settled or _follows(reading, commanded_A, allowed_A, hold_V)
    first = track.sequence is None
    held = hold_V is not None and abs(reading.voltage_V - hold_V) <= HELD_WITHIN_V
    # A voltage that is held may well stay the same to the last bit.
    still = replace(track, repeats=0, unresponsive=0, doubtful=False) if held else None
    seen = track if stale else still or _follow_voltage(track, rules, reading, time_s)
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
        remote_seen=track.remote_seen or "remote" in reading.status,
    )


def _follows(reading: Reading, commanded_A: float, allowed_A: float, hold_V: float | None) -> bool:
    """Whether the current is what it was told to be.

    Where the device holds a voltage: less only where it is held, and none where it is passed.
    """
    if hold_V is None or commanded_A == 0.0:
        return abs(reading.current_A - commanded_A) <= allowed_A
    sign = 1.0 if commanded_A > 0.0 else -1.0
    beyond_V, current_A = (reading.voltage_V - hold_V) * sign, reading.current_A * sign
    least_A = abs(commanded_A) if beyond_V < -HELD_WITHIN_V else 0.0
    most_A = 0.0 if beyond_V > HELD_WITHIN_V else abs(commanded_A)
    return least_A - allowed_A <= current_A <= most_A + allowed_A


def _follow_voltage(track: Track, rules: Rules, reading: Reading, time_s: float) -> Track:
    """Note whether the voltage of a fresh sample is alive."""
    same = track.sequence is not None and reading.voltage_V == track.voltage_V
    step_A = 0.0 if track.sequence is None else abs(reading.current_A - track.current_A)
    moved_A = step_A if same else 0.0
    stepped_s = time_s if step_A > 2 * rules.current_tolerance_A else track.stepped_s
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
    moving = same and time_s - stepped_s <= MOVING_S
    return replace(after, doubtful=dull or moving or (same and track.doubtful), stepped_s=stepped_s)
