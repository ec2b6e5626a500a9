"""Voltage and current that are not sampled at the same time."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.effect import Effect, Parameter, Shift
from models.effects.expected import Expected
from models.effects.reading import InputCorrection
from models.effects.view import View

_LIMIT_SAMPLES = 6.0
_STEP_SAMPLES = 0.05
# Part of a sample by which the delay may differ from log to log without a change: voltage and current go through the
# same converter in each. With a fifth, delays of less than a half were taken for nothing (3 to 4 mV, in class); with
# this no delay is told in 80 logs of foreign cells, 39 measured ones and 16 of PyBaMM in which nothing has changed.
_GRANTED_SAMPLES = 0.05
# The voltage bends at every whole sample, and a spike that is missed by one shows no slope at all: each is looked at.
_STARTS = (-4.0, -3.0, -2.0, -1.0, -0.3, 0.3, 1.0, 2.0, 3.0, 4.0)


def _voltage(view: View, delay_s: float) -> FloatArray:
    """Between two samples the voltage is taken as a straight line."""
    samples = delay_s / view.run.dt_s
    whole = int(np.floor(samples))
    share = samples - whole
    late = (1.0 - share) * view.late_V(whole)
    return late + share * view.late_V(whole + 1) if share else late


def _regressors(view: View) -> FloatArray:
    """Change of the voltage in V for each second that it comes later, from the current one sample later."""
    return view.late_V(1)[:, None] / view.run.dt_s


EFFECT = Effect(
    name="dead_time",
    title="Delay between voltage and current",
    recognise="spikes in the error at every step of the current, of opposite sign to the step, and nothing in between",
    source="sampling model, straight between two samples",
    parameters=(Parameter("delay_s", "s", "time by which the voltage comes after the current"),),
    shows_over=("since_step_s",),
    regressors=_regressors,
    shift=Shift(
        _voltage,
        lambda view: _STEP_SAMPLES * view.run.dt_s,
        lambda view: (-_LIMIT_SAMPLES * view.run.dt_s, _LIMIT_SAMPLES * view.run.dt_s),
        searched=False,
    ),
    absorbed=True,
    correction=InputCorrection(delay_s=lambda values: values["delay_s"]),
    expected=Expected(width=lambda view: view.run.dt_s, starts=_STARTS, granted=lambda _view: _GRANTED_SAMPLES),
)
