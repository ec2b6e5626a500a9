"""Corrections of a run's inputs: effects that sit in a sensor or in an assumption, not in the network's structure.

A model that was made with such an effect holds it in `record.effects`. Whoever gives it a run, gives the run as the
model reads it: a whole run by `as_read`, one sample after the other by `LiveCorrection`.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.effects import Effect, effects
from models.effects.reading import InputCorrection, Reading, Values
from models.network.cell_model import CellRecord
from models.network.model_record import AddedEffect


@dataclass(frozen=True)
class Correction:
    """An effect that is put right in a run's columns.

    Attributes
    ----------
    effect : name
    values : of its parameters
    """

    effect: str
    values: Values


def corrected(run: TimeSeries, effect: Effect, values: Values) -> TimeSeries:
    """Return a run as it would have been measured without an effect, as far as that is in its sensors.

    Parameters
    ----------
    run : as measured
    effect : any
    values : of its parameters

    Raises
    ------
    ModelError
        The correction needs a column that the run does not have.
    """
    correction = effect.correction
    if correction is None:
        return run
    if correction.needs_ambient and run.ambient_degC is None:
        raise ModelError(
            f"{run.name}: {effect.title.lower()} is corrected against ambient temperature, which was not measured"
        )
    if correction.sample is not None:
        read = Reading(run.current_A, run.voltage_V, run.temperature_degC, run.ambient_degC)
        run = replace(run, **correction.sample(read, values)._asdict())
    return run if correction.delay_s is None else _on_time(run, correction.delay_s(values))


def _on_time(run: TimeSeries, delay_s: float) -> TimeSeries:
    known = np.isfinite(run.voltage_V)
    earlier = np.interp(run.time_s + delay_s, run.time_s[known], run.voltage_V[known])
    return replace(run, voltage_V=np.where(known, earlier, np.nan))


def corrections_of(record: CellRecord) -> tuple[Correction, ...]:
    """Corrections that a model's record says its runs need, in the order in which they were found.

    Raises
    ------
    ModelError
        The record is damaged, or names a correction that is not known.
    """
    try:
        found = [each for each in record.effects if each.get("correction")]
        corrections = tuple(Correction(each["effect"], _values(each)) for each in found)
        possible = [_sensible(_way(each), each.values) for each in corrections]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ModelError(f"the model's record of its corrections is damaged: {error!r}") from None
    for each, sensible in zip(corrections, possible, strict=True):
        if not sensible:
            raise ModelError(f"the model's record of its correction for {each.effect} holds {each.values}")
    return corrections


def check_correction(effect: Effect, values: Values) -> None:
    """Refuse values of an effect with which nothing is put right.

    Raises
    ------
    ModelError
        The effect is put right in a run's columns, and cannot be with these, or they are the least that there are.
    """
    if effect.correction is None:
        return
    least = zip(effect.parameters, effect.warmth.least if effect.warmth else (), strict=False)
    if _sensible(effect.correction, values) and all(values[each.name] > low for each, low in least):
        return
    units = {each.name: "" if each.unit == "1" else f" {each.unit}" for each in effect.parameters}
    told = ", ".join(f"{name} = {value:.4g}{units.get(name, '')}" for name, value in values.items())
    raise ModelError(
        f"{effect.name}: the training runs show {told}, which no correction of their columns puts right: look at the "
        "sensor, or name runs that show it better"
    )


def _sensible(way: InputCorrection, values: Values) -> bool:
    return way.possible(values) and all(math.isfinite(value) for value in values.values())


def _values(entry: AddedEffect) -> Values:
    parameters = effects()[entry["effect"]].parameters
    return {each.name: float(entry["parameters"][each.name]["value"]) for each in parameters}


def _way(correction: Correction) -> InputCorrection:
    """How it is done; a KeyError where there is no such effect, or none in the sensors."""
    way = effects()[correction.effect].correction
    if way is None:
        raise KeyError(correction.effect)
    return way


def as_read(record: CellRecord, run: TimeSeries) -> TimeSeries:
    """Return a run as a model with this record reads it: with the corrections that it was made with."""
    for each in corrections_of(record):
        run = corrected(run, effects()[each.effect], each.values)
    return run


class LiveCorrection:
    """The same sample by sample, on an even grid; where the voltage comes late, the samples come late as well.

    Parameters
    ----------
    corrections : as `corrections_of` gives them
    dt_s : sampling time
    """

    def __init__(self, corrections: tuple[Correction, ...], dt_s: float) -> None:
        ways = [(_way(each), each.values) for each in corrections]
        self._in_place = [(way.sample, values) for way, values in ways if way.sample is not None]
        delay_s = sum(way.delay_s(values) for way, values in ways if way.delay_s is not None)
        steps = delay_s / dt_s
        self._late = max(math.ceil(steps), 0)
        # The voltage is taken this many samples before the newest one.
        self._back = self._late - steps
        self._kept: deque[Reading] = deque(maxlen=max(self._late, math.ceil(self._back)) + 1)

    def step(self, read: Reading) -> Reading | None:
        """Take a sample as measured; give the newest one that can be put right, None where none can be yet."""
        for without, values in self._in_place:
            read = without(read, values)
        self._kept.append(read)
        if len(self._kept) <= self._late:
            return None
        sample = self._kept[-1 - self._late]
        return sample._replace(voltage_V=self._voltage_V(sample.voltage_V))

    def _voltage_V(self, own_V: float) -> float:
        if math.isnan(own_V):
            return math.nan
        whole = math.floor(self._back)
        share, last = self._back - whole, len(self._kept) - 1
        newer, older = (self._kept[last - min(back, last)].voltage_V for back in (whole, whole + 1))
        return newer if share == 0.0 else (1.0 - share) * newer + share * older
