"""Amplitude-modulated pseudo-random steps: random levels, held for random times, over a slow sweep of the charge."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.design.test_signals.family import Family, FamilyRequest, held, sweep_A

# Shortest and longest hold in s: from the fast to the middle time constants of cells.
_HOLD_S = (3.0, 100.0)


def _build(request: FamilyRequest, rng: np.random.Generator) -> FloatArray:
    shortest, longest = (request.samples(hold) for hold in _HOLD_S)
    most = -(-request.n_samples // shortest)
    counts = rng.integers(shortest, longest + 1, most)
    mean = sweep_A(request)
    levels = held(rng.uniform(-1.0, 1.0, most), counts, request.n_samples)
    room = np.where(levels > 0.0, request.current_A[1] - mean, mean - request.current_A[0])
    # As much out as in: the asymmetry of the limits must not carry the charge away.
    room = np.minimum(room, request.amplitude_A - np.abs(mean))
    return mean + levels * room


FAMILY = Family("aprbs", "amplitude-modulated pseudo-random steps (Nelles 2001, ch. 17)", _build)
