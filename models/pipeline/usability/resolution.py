"""Columns that are rounded so coarsely that what they should show is lost."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.pipeline.training import Training
from models.pipeline.usability.reason import Reason, limited

# Rounding leaves an error of 0.29 steps: with a step of a tenth of what is read, 3 % of it, about what resistances of
# one cell scatter by from measurement to measurement.
_COARSE = 0.1
# Where no step of the current shows what an answer is: of the span of the voltage.
_COARSE_OF_SPAN = 0.01
_CHANGE = 0.1
# Numbers themselves are rounded to this. A column is rounded to a step where its values gather at multiples of it
# (mean resultant length of their phases, 1 where all do): so many of them that a few odd ones, such as means over a
# change, do not hide it.
_ROUND_OFF, _GATHERED = 1e-6, 0.9
_TRIED = 5


def coarse_values(data: Training) -> list[Reason]:
    """Whether voltage or current is rounded too coarsely."""
    found = []
    step_V = max(rounding(run.voltage_V) for run in data.runs)
    answer_V = _answer_V(data)
    if step_V > answer_V:
        found.append(
            limited(
                f"voltage is logged in steps of {1e3 * step_V:.0f} mV, too coarse for what pulses do to it: "
                f"resistances and the slope of the open-circuit voltage are not known well; log it to "
                f"{1e3 * answer_V:.1g} mV or finer"
            )
        )
    step_A = max(rounding(run.current_A) for run in data.runs)
    rms_A = float(np.sqrt(np.mean(np.concatenate([run.current_A for run in data.grid]) ** 2)))
    if step_A > _COARSE * rms_A:
        found.append(
            limited(
                f"current is logged in steps of {step_A:.3g} A, where {rms_A:.3g} A flow on average: counted charge "
                f"and resistances are off by that share; log it to {_COARSE * rms_A:.1g} A or finer"
            )
        )
    return found


def rounding(values: FloatArray) -> float:
    """Step that values are rounded to; 0 where they are not."""
    known = np.round(values[~np.isnan(values)] / _ROUND_OFF)
    apart, often = np.unique(np.diff(np.unique(known)), return_counts=True)
    tried = apart[np.argsort(-often, kind="stable")[:_TRIED]]
    # Relative to the most frequent value: steps need not be multiples counted from 0.
    at, count = np.unique(known, return_counts=True)
    away = known - at[np.argmax(count)] if len(at) else known
    steps = [step for step in tried if abs(np.mean(np.exp(2j * np.pi * away / step))) > _GATHERED]
    return float(max(steps, default=0.0)) * _ROUND_OFF


def _answer_V(data: Training) -> float:
    """Coarsest step in V that shows what it should."""
    largest = max(float(np.abs(run.current_A).max()) for run in data.grid)
    answers = [np.abs(np.diff(run.voltage_V))[np.abs(np.diff(run.current_A)) > _CHANGE * largest] for run in data.grid]
    known = np.concatenate(answers)
    known = known[~np.isnan(known)]
    if len(known):
        return _COARSE * float(np.median(known))
    return _COARSE_OF_SPAN * float(np.ptp(np.concatenate([run.voltage_V[run.measured] for run in data.grid])))
