"""By how much the mean state of charge is behind that at the surface of the particles.

Two electrodes make one voltage, and where one of them diffuses much more slowly the other one stands at the mean state
of charge. A curve over the slow one's surface then runs ahead with all of its slope; this signal takes back what is the
other's share.
"""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.network.signals.filters import FURTHEST_BEHIND
from models.network.signals.kind import Signal, SignalKind
from models.network.signals.loop_form import DIFFUSION, LoopForm
from models.network.signals.surface_soc import PARAMETERS, diffusion_loop, lead, lead_after_step, settled_lead


def _behind(ahead: FloatArray) -> FloatArray:
    return np.clip(-ahead, -FURTHEST_BEHIND, FURTHEST_BEHIND)


def _loop(signal: Signal, dt_s: float, capacity_Ah: float) -> LoopForm:
    ahead = diffusion_loop(DIFFUSION, signal, dt_s, capacity_Ah)
    return ahead._replace(factor=-ahead.factor)


KIND = SignalKind(
    name="behind_surface",
    title="how far the mean state of charge is behind that at the surface of the particles, as a fraction",
    example="behind_surface:0.05/300/3500/10",
    parameters=PARAMETERS,
    values=lambda signal, run: _behind(lead(signal, run)),
    settled=lambda signal, points: _behind(settled_lead(signal, points)),
    after_step=lambda signal, step: _behind(lead_after_step(signal, step)),
    loop=_loop,
)
