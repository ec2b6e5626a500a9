"""A recorded load cycle, repeated, scaled into the current's limits; charged again when the window's end is reached."""

from __future__ import annotations

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.design.test_signals.family import Family, FamilyRequest, Sequence

_CHARGE_SHARE = 0.5


def _build(request: FamilyRequest, rng: np.random.Generator) -> FloatArray:
    cycle = request.cycle_A
    if cycle is None or not np.abs(cycle).max() > 0.0:
        raise ModelError("signal drive_cycle replays a load cycle, but none was given: name its file in load_cycle")
    scale = min(
        request.current_A[0] / cycle.min() if cycle.min() < 0.0 else np.inf,
        request.current_A[1] / cycle.max() if cycle.max() > 0.0 else np.inf,
    )
    played, sequence = cycle * scale, Sequence(request)
    low, high = request.soc
    most = float(np.abs(np.cumsum(played)).max()) * request.dt_s / (3600.0 * request.capacity_Ah)
    sequence.move(high - sequence.soc, _CHARGE_SHARE * request.current_A[1])
    while not sequence.full:
        for current_A in played:
            sequence.hold(float(current_A), request.dt_s)
        if sequence.soc - most < low:
            sequence.move(high - sequence.soc, _CHARGE_SHARE * request.current_A[1])
        elif sequence.soc + most > high and played.sum() > 0.0:
            sequence.move(low - sequence.soc, _CHARGE_SHARE * -request.current_A[0])
    return sequence.current_A()


FAMILY = Family("drive_cycle", "a recorded load cycle, repeated", _build)
