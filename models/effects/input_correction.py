"""Corrections of a run's inputs: effects that sit in a sensor or in an assumption, not in the network's structure.

A model that was made with such an effect holds it in `record.effects`. Whoever gives it a run, gives the run as the
model reads it: a whole run by `as_read`, one sample after the other by `LiveCorrection`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.network.cell_model import CellRecord

Values = dict[str, float]


class Reading(NamedTuple):
    """What sensors say: one sample or arrays of them, NaN where missing."""

    current_A: Any
    voltage_V: Any
    temperature_degC: Any
    ambient_degC: Any


def _current_offset(read: Reading, values: Values) -> Reading:
    return read._replace(current_A=read.current_A - values["offset_A"])


def _self_discharge(read: Reading, values: Values) -> Reading:
    """What charges the cell is what the sensor reads less what leaks."""
    return read._replace(current_A=read.current_A - values["leakage_A"])


def _voltage_offset(read: Reading, values: Values) -> Reading:
    return read._replace(voltage_V=read.voltage_V - values["offset_V"])


def _temperature_sensor(read: Reading, values: Values) -> Reading:
    rise_K = (read.temperature_degC - values["offset_K"] - read.ambient_degC) / values["gain"]
    return read._replace(temperature_degC=read.ambient_degC + rise_K)


# Sample by sample; a delay is the only one that looks at other samples.
_IN_PLACE: dict[str, Callable[[Reading, Values], Reading]] = {
    "current_offset": _current_offset,
    "self_discharge": _self_discharge,
    "voltage_offset": _voltage_offset,
    "temperature_sensor": _temperature_sensor,
}
_NEEDED = {
    "current_offset": ("offset_A",),
    "self_discharge": ("leakage_A",),
    "voltage_offset": ("offset_V",),
    "temperature_sensor": ("gain", "offset_K"),
    "dead_time": ("delay_s",),
}


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


def corrects_inputs(effect: str) -> bool:
    """Whether an effect is put right in a run's columns."""
    return effect in _NEEDED


def corrected(run: TimeSeries, effect: str, values: Values) -> TimeSeries:
    """Return a run as it would have been measured without an effect in its sensors.

    Parameters
    ----------
    run : as measured
    effect : name
    values : of its parameters

    Raises
    ------
    ModelError
        The correction needs a column that the run does not have.
    """
    if effect == "dead_time":
        return _on_time(run, values["delay_s"])
    if effect not in _IN_PLACE:
        return run
    if effect == "temperature_sensor" and run.ambient_degC is None:
        raise ModelError(
            f"{run.name}: a temperature sensor's gain is corrected against ambient, which was not measured"
        )
    read = _IN_PLACE[effect](Reading(run.current_A, run.voltage_V, run.temperature_degC, run.ambient_degC), values)
    return replace(run, current_A=read.current_A, voltage_V=read.voltage_V, temperature_degC=read.temperature_degC)


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
        corrections = tuple(
            Correction(
                each["effect"], {name: float(each["parameters"][name]["value"]) for name in _NEEDED[each["effect"]]}
            )
            for each in found
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ModelError(f"the model's record of its corrections is damaged: {error!r}") from None
    for each in corrections:
        if not all(math.isfinite(value) for value in each.values.values()) or each.values.get("gain") == 0.0:
            raise ModelError(f"the model's record of its correction for {each.effect} holds {each.values}")
    return corrections


def as_read(record: CellRecord, run: TimeSeries) -> TimeSeries:
    """Return a run as a model with this record reads it: with the corrections that it was made with."""
    for each in corrections_of(record):
        run = corrected(run, each.effect, each.values)
    return run


class LiveCorrection:
    """The same sample by sample, on an even grid; where the voltage comes late, the samples come late as well.

    Parameters
    ----------
    corrections : as `corrections_of` gives them
    dt_s : sampling time
    """

    def __init__(self, corrections: tuple[Correction, ...], dt_s: float) -> None:
        self._in_place = [each for each in corrections if each.effect in _IN_PLACE]
        delay_s = sum(each.values["delay_s"] for each in corrections if each.effect == "dead_time")
        steps = delay_s / dt_s
        self._late = max(math.ceil(steps), 0)
        # The voltage is taken this many samples before the newest one.
        self._back = self._late - steps
        self._kept: deque[Reading] = deque(maxlen=max(self._late, math.ceil(self._back)) + 1)

    def step(self, read: Reading) -> Reading | None:
        """Take a sample as measured; give the newest one that can be put right, None where none can be yet."""
        for each in self._in_place:
            read = _IN_PLACE[each.effect](read, each.values)
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
