"""Pseudo-random binary sequence: full amplitude either way, from a shift register, over a slow sweep of the charge."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.design.test_signals.family import Family, FamilyRequest, held, sweep_A

# Clock in s: below the faster time constants of cells, slow enough for their longer ones to build up.
_CLOCK_S = 5.0
# Feedback taps of maximum length (Golomb, "Shift Register Sequences", 1967).
_TAPS = {10: (10, 7), 14: (14, 13, 12, 2)}


def _build(request: FamilyRequest, rng: np.random.Generator) -> FloatArray:
    hold = request.samples(_CLOCK_S)
    bits = _register(-(-request.n_samples // hold), rng)
    mean = sweep_A(request)
    signs = held(2.0 * bits - 1.0, np.full(len(bits), hold), request.n_samples)
    return mean + signs * (request.amplitude_A - np.abs(mean))


def _register(count: int, rng: np.random.Generator) -> FloatArray:
    length = 10 if count < 2**10 else 14
    state = rng.integers(0, 2, length)
    state[0] |= not state.any()
    out = np.empty(count)
    for k in range(count):
        out[k] = state[-1]
        feedback = int(sum(state[tap - 1] for tap in _TAPS[length])) % 2
        state[1:] = state[:-1].copy()
        state[0] = feedback
    return out


FAMILY = Family("prbs", "pseudo-random binary sequence (Golomb 1967)", _build)
