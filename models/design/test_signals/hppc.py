"""Pulse pairs at ten levels of the charge: 10 s discharge, 40 s rest, 10 s charge at 3/4 of it, then on to the next."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.design.test_signals.family import Family, FamilyRequest, Sequence

_LEVELS = 10
_PULSE_S, _BETWEEN_S, _CHARGE_RATIO = 10.0, 40.0, 0.75
_MOVE_SHARE = 0.5


def _build(request: FamilyRequest, rng: np.random.Generator) -> FloatArray:
    sequence = Sequence(request)
    low, high = request.soc
    per_soc_As = 3600.0 * request.capacity_Ah
    sequence.move(high - sequence.soc, _MOVE_SHARE * request.current_A[1])
    discharge_A = min(-request.current_A[0], request.current_A[1] / _CHARGE_RATIO)
    step = (high - low) / _LEVELS
    pair = (1.0 - _CHARGE_RATIO) * discharge_A * _PULSE_S / per_soc_As
    move_A = _MOVE_SHARE * -request.current_A[0]
    busy_s = 2.0 * _PULSE_S + 2.0 * _BETWEEN_S + max(step - pair, 0.0) * per_soc_As / move_A
    left_s = request.duration_s - (high - request.initial_soc) * per_soc_As / (_MOVE_SHARE * request.current_A[1])
    rest_s = max(left_s / _LEVELS - busy_s, request.dt_s)
    for _ in range(_LEVELS):
        sequence.hold(0.0, rest_s)
        sequence.hold(-discharge_A, _PULSE_S)
        sequence.hold(0.0, _BETWEEN_S)
        sequence.hold(_CHARGE_RATIO * discharge_A, _PULSE_S)
        sequence.hold(0.0, _BETWEEN_S)
        sequence.move(-max(step - pair, 0.0), move_A)
    return sequence.current_A()


FAMILY = Family("hppc", "hybrid pulse power characterisation (INL/EXT-07-12536, 2010)", _build)
