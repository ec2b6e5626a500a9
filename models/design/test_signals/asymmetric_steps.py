"""Steps of several sizes that discharge more than they charge, then the other way round: down and up the window."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.design.test_signals.family import Family, FamilyRequest, Sequence

# Of the largest current; the sum moves the charge.
_STEPS = (-1.0, 0.5, -0.75, 0.0, -0.5, 0.25, -0.25, 0.0)
_REST_SHARE = 0.25


def _build(request: FamilyRequest, rng: np.random.Generator) -> FloatArray:
    sequence = Sequence(request)
    low, high = request.soc
    per_round = -sum(_STEPS) * request.amplitude_A / (3600.0 * request.capacity_Ah)
    way = 2.0 * (high - low) + (high - request.initial_soc)
    # The steps last as long as it takes to go down and up once.
    step_s = max(request.dt_s, min(60.0, way / per_round * request.dt_s))
    rounds = way / (per_round * step_s)
    rest_s = max(request.duration_s / max(rounds, 1.0) - len(_STEPS) * step_s, 0.0) / 2.0
    direction = 1.0
    while not sequence.full:
        for share in _STEPS:
            sequence.hold(direction * share * request.amplitude_A, step_s)
            if share == 0.0 and rest_s >= request.dt_s:
                sequence.hold(0.0, rest_s)
        at_end = (
            sequence.soc >= high - per_round * step_s if direction < 0.0 else sequence.soc <= low + per_round * step_s
        )
        direction = -direction if at_end else direction
    return sequence.current_A()


FAMILY = Family("asymmetric_steps", "asymmetric current steps (Hu et al. 2009)", _build)
