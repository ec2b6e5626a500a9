"""Sum of sines at frequencies spread evenly over the decades, phases random, over a slow sweep of the charge."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.design.test_signals.family import Family, FamilyRequest, sweep_A

_SINES = 40
# Periods in s, from four samples to the slow end of what a test of hours can show.
_LONGEST_S = 2000.0
_TRIALS = 20


def _build(request: FamilyRequest, rng: np.random.Generator) -> FloatArray:
    longest_s = min(_LONGEST_S, request.n_samples * request.dt_s)
    periods_s = np.geomspace(4.0 * request.dt_s, max(longest_s, 4.0 * request.dt_s), _SINES)
    time_s = request.dt_s * np.arange(request.n_samples)
    angles = 2.0 * np.pi * time_s[:, None] / periods_s
    phases = rng.uniform(0.0, 2.0 * np.pi, (_SINES, _TRIALS))
    waves = np.sin(angles) @ np.cos(phases) + np.cos(angles) @ np.sin(phases)
    largest = np.maximum(np.abs(waves).max(axis=0), 1e-12)
    best = int(np.argmin(largest / np.maximum(waves.std(axis=0), 1e-12)))
    mean = sweep_A(request)
    return mean + waves[:, best] / largest[best] * (request.amplitude_A - np.abs(mean))


FAMILY = Family("multisine", "random-phase multisine, least crest of 20 (Pintelon and Schoukens 2012, ch. 2)", _build)
