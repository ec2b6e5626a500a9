"""What ends a run for the chamber's sake. Pure: what is known of it in, what is violated out."""

import math
from dataclasses import dataclass

from bench_service.bench.chamber.settings import ChamberSettings
from bench_service.bench.safety.trip import Context, Trip, trip
from drivers.chamber import ChamberReading

# A set point is kept by the chamber in steps of its own.
_STEP_K = 0.1
CHANGED_LIMIT = 2  # looks in a row


@dataclass(frozen=True, slots=True)
class Known:
    """What is known of a chamber in a run.

    Parameters
    ----------
    reading : ChamberReading or None
        The last one; None: it does not answer.
    heard_s : float
        Time of the run at which it last told a temperature.
    changed : int
        Looks in a row at which it was not as it had been told.
    told_degC : float or None
        What it was told; None: nothing.
    """

    reading: ChamberReading | None = None
    heard_s: float = 0.0
    changed: int = 0
    told_degC: float | None = None


def follow(known: Known, reading: ChamberReading | None, time_s: float, told_degC: float | None) -> Known:
    """Return what is known after a look at `time_s`; `told_degC` only where the chamber has taken it."""
    if reading is None or reading is known.reading:
        return Known(reading, known.heard_s, known.changed, told_degC)
    heard_s = known.heard_s if math.isnan(reading.temperature_degC) else time_s
    other = told_degC is not None and not (reading.on and abs(reading.setpoint_degC - told_degC) <= _STEP_K)
    same = known.told_degC == told_degC
    return Known(reading, heard_s, known.changed + 1 if other and same else int(other), told_degC)


def check(known: Known, settings: ChamberSettings, context: Context) -> Trip | None:
    """Return the first rule that is violated."""
    reading = known.reading
    if reading is not None and reading.alarms:
        alarms = ", ".join(sorted(reading.alarms))
        return trip(
            context, "chamber_fault", f"the temperature chamber reports {alarms}", "remove the cause, acknowledge"
        )
    silent_s = context.now_s - known.heard_s
    if not silent_s <= settings.lost_s:
        what = "has not answered" if reading is None else "has told no temperature"
        text = f"the temperature chamber {what} for {silent_s:.3g} s, limit {settings.lost_s:g} s"
        return trip(context, "chamber_lost", text, "check the chamber and its link, acknowledge")
    if reading is None or math.isnan(reading.temperature_degC):
        return None
    low, high = settings.air_degC
    if not low <= reading.temperature_degC <= high:
        text = f"the chamber's air {reading.temperature_degC:.4g} degC is outside {low:g} to {high:g} degC"
        return trip(context, "chamber_limit", text, "check the chamber, acknowledge")
    if known.changed >= CHANGED_LIMIT:
        now = f"at {reading.setpoint_degC:g} degC" if reading.on else "off"
        text = f"the temperature chamber is {now}, it was told {known.told_degC:g} degC"
        return trip(context, "chamber_changed", text, "find out who changed it at its panel, acknowledge")
    return None
