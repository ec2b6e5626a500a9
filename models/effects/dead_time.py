"""Voltage and current that are not sampled at the same time."""

from __future__ import annotations

import numpy as np

from models.effects.effect import Effect, Parameter
from models.effects.view import View
from models.timeseries import FloatArray


def _regressors(view: View) -> FloatArray:
    """Change of the voltage in V for each second that it comes later, from the current one sample later."""
    current_A = view.run.current_A
    later_A = np.concatenate([current_A[:1], current_A[:-1]])
    return view.moved(current_A=later_A)[:, None] / view.run.dt_s


EFFECT = Effect(
    name="dead_time",
    title="Delay between voltage and current",
    recognise="spikes in the error at every step of the current, of opposite sign to the step, and nothing in between",
    source="sampling model, first order",
    parameters=(Parameter("delay_s", "s", "time by which the voltage comes after the current"),),
    regressors=_regressors,
    absorbed=True,
)
