"""Constant discharge pulses with rests from a full to an empty cell; the first part of the time charges it."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.design.test_signals.family import Family, FamilyRequest, Sequence

_PULSES = 10
_CHARGE_SHARE = 0.5


def _build(request: FamilyRequest, rng: np.random.Generator) -> FloatArray:
    sequence = Sequence(request)
    low, high = request.soc
    sequence.move(high - sequence.soc, _CHARGE_SHARE * request.current_A[1])
    pulse_A = _CHARGE_SHARE * -request.current_A[0]
    step = (high - low) / _PULSES
    pulse_s = step * 3600.0 * request.capacity_Ah / pulse_A
    left_s = request.duration_s - (high - request.initial_soc) * 3600.0 * request.capacity_Ah / (
        _CHARGE_SHARE * request.current_A[1]
    )
    rest_s = max(left_s / _PULSES - pulse_s, request.dt_s)
    for _ in range(_PULSES):
        sequence.move(-step, pulse_A)
        sequence.hold(0.0, rest_s)
    return sequence.current_A()


FAMILY = Family("discharge_pulses", "constant discharge pulses with rests (Gao et al. 2002)", _build)
