"""Whether the observer can be believed: innovations against their band, a sensor that stands still, data that is gone.

A wrong model shows where the current changes. What does not change looks like another state of charge: a cell at rest
whose voltage is on the model's curve, or a curve that is off by as much everywhere, cannot be told by its voltage.

One step function for live and replay, as for the observer itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from models.data.timeseries import FloatArray
from models.observer.filter import places
from models.observer.filter.fuzzy_observer import ObserverOutput

# Bits of an alarm.
MODEL, STUCK, MISSING, RANGE = 1, 2, 4, 8
REASONS = {
    MODEL: "the model does not fit the measured voltage: another cell, a changed cell, or a wrong sensor",
    STUCK: "the voltage reading stands still while the current moves the cell: the sensor or its link is stuck",
    MISSING: "no voltage for too long: charge is only counted",
    RANGE: "the state of charge is held at its limit: capacity, current sign or the model are wrong",
}
# Memory: mean squared normalised innovation, products of neighbours, last normalised innovation, last reading, for how
# many samples it has not changed, lowest and highest expectation since, samples without voltage, at the limit, and with
# an error beyond all that was assumed; cumulative sum of what the squared innovations have too much.
NIS, PRODUCT, LAST, READING, SAME, LOWEST, HIGHEST, GONE, AT_LIMIT, BEYOND, SUM = range(11)
N_MEMORY = 11
# Samples over which the innovations are averaged.
_WINDOW = 20.0
# A single spike counts no more than this, so that it alone is no alarm.
_SPIKE = 25.0
# Cumulative sum (Page, Biometrika 41, 1954) of squared normalised innovations, 1 on average as assumed, less this; the
# model does not fit where it is beyond the limit. White innovations of the assumed size get there once in more than
# exp(0.398 x 50) = 4e8 samples, 0.398 being the root of (1 - 2 t)^(-1/2) = exp(2 t) (Wald's bound). It goes no
# further than twice the limit, so that the alarm ends within a minute or so of what caused it.
_ALLOWED = 2.0
_MOST_SUM = 50.0
# The filter's own estimate of the model's error beyond which it contradicts what was assumed, and for how long.
_MOST_SIGMA = 5.0
_BEYOND_SAMPLES = 10
# A reading that has not changed in so many samples while the expectation moved by so many standard deviations is stuck.
_SAME_SAMPLES = 10
_MOVED_SIGMA = 6.0
# Samples without voltage, and at the limit, until somebody is told.
_GONE_SAMPLES = 60
_LIMIT_SAMPLES = 60


@dataclass(frozen=True)
class Health:
    """Verdict after a sample.

    Attributes
    ----------
    nis : mean squared normalised innovation over the last samples; 1 is as assumed
    correlation : of neighbouring innovations; 0 where they are white
    alarm : bits of MODEL, STUCK, MISSING, RANGE
    """

    nis: float
    correlation: float
    alarm: int

    @property
    def reasons(self) -> list[str]:
        """What is wrong, in words."""
        return [text for bit, text in REASONS.items() if self.alarm & bit]


_step: Any
_watch: Any


def fresh_memory() -> FloatArray:
    """Memory before the first sample."""
    memory = np.zeros(N_MEMORY)
    memory[NIS], memory[READING] = 1.0, np.nan
    return memory


def step(memory: FloatArray, row: FloatArray, voltage_V: float) -> tuple[FloatArray, Health]:
    """Judge one sample.

    Parameters
    ----------
    memory : as it was after the last sample (left as it is)
    row : (columns,) what the observer said
    voltage_V : what was measured, NaN where missing
    """
    new, out = memory.copy(), np.empty(3)
    _step(new, row, voltage_V, out)
    return new, Health(float(out[0]), float(out[1]), int(out[2]))


class Watcher:
    """Keeps the memory for a live observer, and tells each alarm once for as long as it lasts."""

    def __init__(self) -> None:
        self._memory = fresh_memory()
        self._before: list[str] = []
        self._now: list[str] = []
        self.health = Health(1.0, 0.0, 0)

    def step(self, out: ObserverOutput, voltage_V: float) -> Health:
        """Judge one sample."""
        self._memory, self.health = step(self._memory, out.row, voltage_V)
        self._now = self.health.reasons
        return self.health

    def new_alarms(self) -> list[str]:
        """Return the alarms that were not there when this was last asked."""
        new = [reason for reason in self._now if reason not in self._before]
        self._before = self._now
        return new


def watch(rows: FloatArray, voltage_V: FloatArray) -> FloatArray:
    """(N, 3) mean squared normalised innovation, correlation and alarm bits over a whole run."""
    out = np.empty((len(rows), 3))
    _watch(fresh_memory(), rows, np.ascontiguousarray(voltage_V, dtype=np.float64), out)
    return out


def alarms_of(watched: FloatArray) -> list[str]:
    """Alarms of a whole run in words, each with the share of the run in which it stood."""
    bits = watched[:, 2].astype(int)
    standing = {text: np.flatnonzero(bits & bit) for bit, text in REASONS.items()}
    return [f"{text} ({_share(len(rows), len(bits))})" for text, rows in standing.items() if len(rows)]


def _share(n: int, of: int) -> str:
    percent = 100.0 * n / of
    return f"{percent:.1f} % of the run" if percent >= 0.1 else f"{n} of its {of} samples"


@njit(cache=True)
def _compiled_step(memory: np.ndarray, row: np.ndarray, voltage_V: float, out: np.ndarray) -> None:
    alarm = 0
    if np.isnan(voltage_V):
        memory[GONE] += 1.0
    else:
        memory[GONE] = 0.0
        normalised = row[places.INNOVATION_OUT] / max(row[places.INNOVATION_STD_OUT], 1e-12)
        share = 1.0 / _WINDOW
        square = min(normalised * normalised, _SPIKE)
        memory[NIS] += share * (square - memory[NIS])
        memory[SUM] = min(max(memory[SUM] + square - _ALLOWED, 0.0), 2.0 * _MOST_SUM)
        bounded = min(max(normalised, -5.0), 5.0)
        memory[PRODUCT] += share / 5.0 * (bounded * memory[LAST] - memory[PRODUCT])
        memory[LAST] = bounded
        expected = row[places.VOLTAGE_OUT]
        if voltage_V == memory[READING]:
            memory[SAME] += 1.0
            memory[LOWEST] = min(memory[LOWEST], expected)
            memory[HIGHEST] = max(memory[HIGHEST], expected)
        else:
            memory[READING], memory[SAME] = voltage_V, 0.0
            memory[LOWEST] = memory[HIGHEST] = expected
    at_limit = row[places.SOC_OUT] <= -places.SOC_SLACK or row[places.SOC_OUT] >= 1.0 + places.SOC_SLACK
    memory[AT_LIMIT] = memory[AT_LIMIT] + 1.0 if at_limit else 0.0
    memory[BEYOND] = memory[BEYOND] + 1.0 if row[places.ERROR_OUT] > _MOST_SIGMA else 0.0
    moved = memory[HIGHEST] - memory[LOWEST]
    if memory[SAME] >= _SAME_SAMPLES and moved > _MOVED_SIGMA * row[places.INNOVATION_STD_OUT]:
        alarm += STUCK
    elif memory[SUM] > _MOST_SUM or memory[BEYOND] >= _BEYOND_SAMPLES:
        alarm += MODEL
    if memory[GONE] >= _GONE_SAMPLES:
        alarm += MISSING
    if memory[AT_LIMIT] >= _LIMIT_SAMPLES:
        alarm += RANGE
    out[0], out[2] = memory[NIS], alarm
    out[1] = memory[PRODUCT] / max(memory[NIS], 1e-12)


@njit(cache=True)
def _compiled_watch(memory: np.ndarray, rows: np.ndarray, voltage_V: np.ndarray, out: np.ndarray) -> None:
    for k in range(rows.shape[0]):
        _compiled_step(memory, rows[k], voltage_V[k], out[k])


_step, _watch = _compiled_step, _compiled_watch
