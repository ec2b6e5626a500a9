"""State of charge at the surface of the particles: diffusion lets it run ahead of the mean one.

The open-circuit voltage over it bends where the plain one would shift. With temperature the diffusion slows down as
resistances grow: settled difference and time constants alike. It may slow down towards empty as well, where particles
fill up and have few places left to move to.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from models.data.timeseries import FloatArray
from models.network.signals.driven import ACTIVATION, TIME_CONSTANT, drive
from models.network.signals.filters import diffusion, diffusion_rates, slower_when_empty
from models.network.signals.kind import Held, Parameter, Points, Run, Signal, SignalKind, Step
from models.network.signals.loop_form import SOC, LoopForm
from models.network.signals.temperature_scale import arrhenius


def lead(signal: Signal, run: Run) -> FloatArray:
    """(n,) by how much the surface's state of charge is ahead of the mean over a whole run."""
    return _share(signal, run, _diffused(signal, run, _drive(signal, run), run.dt_s))


def settled_lead(signal: Signal, points: Held) -> FloatArray:
    """(n,) the same where everything is held."""
    return _share(signal, points, _drive(signal, points))


def lead_after_step(signal: Signal, step: Step) -> FloatArray:
    """(n,) the same around a step of the current."""
    x = _drive(signal, step)
    return _share(signal, step, x[0] + _diffused(signal, step, x - x[0], step.dt_s))


def _drive(signal: Signal, points: Points) -> FloatArray:
    """(n,) current times how much slower than at 25 degC and full it diffuses."""
    emptying = signal.get("emptying")
    return drive(signal, points) * (slower_when_empty(emptying, points.soc) if emptying else 1.0)


def _diffused(signal: Signal, points: Points, x: FloatArray, dt_s: float) -> FloatArray:
    activation_K = signal.get("activation_K")
    slower = arrhenius(points.temperature_degC, activation_K) if activation_K else np.ones(1)
    if emptying := signal.get("emptying"):
        slower = slower * slower_when_empty(emptying, points.soc)
    return diffusion(x, signal.get("time_constant_s"), slower, dt_s)


def _share(signal: Signal, points: Points, shift_A: FloatArray) -> FloatArray:
    return signal.get("depth") * shift_A / points.capacity_Ah


def diffusion_loop(form: int, signal: Signal, dt_s: float, capacity_Ah: float) -> LoopForm:
    """Row of a diffusion for the compiled loops, of a form that takes one."""
    first, second, third = diffusion_rates(signal.get("time_constant_s"), dt_s).tolist()
    return LoopForm(
        form,
        poles=(first, second, third),
        activation_K=signal.get("activation_K"),
        exchange_A=signal.get("emptying"),
        factor=signal.get("depth") / capacity_Ah,
    )


PARAMETERS = (
    Parameter("depth", "h", positive=False),
    TIME_CONSTANT,
    replace(ACTIVATION, optional=True),
    Parameter("emptying", "1", optional=True),
)

KIND = SignalKind(
    name="surface_soc",
    title="state of charge at the surface of the particles as a fraction",
    example="surface_soc:0.05/300/3500/10",
    parameters=PARAMETERS,
    values=lambda signal, run: run.soc + lead(signal, run),
    settled=lambda signal, points: points.soc + settled_lead(signal, points),
    after_step=lambda signal, step: step.soc + lead_after_step(signal, step),
    loop=partial(diffusion_loop, SOC),
    soc=True,
)
