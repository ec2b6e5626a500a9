"""What of an error is the measurement's noise."""

from __future__ import annotations

import numpy as np

from models.data.metrics import noise_floor_V
from models.diagnosis.reference.samples import Samples

# The noise is known to this factor of its variance: it is told from few and rounded figures.
_NOISE_KNOWN_TO = 1.1


def noise_mse(samples: Samples) -> float:
    """Variance of the measurement's noise in V^2."""
    floors = np.array([noise_floor_V(view.run.voltage_V, view.run.current_A) for view in samples.views])
    known = floors[np.isfinite(floors)]
    return _NOISE_KNOWN_TO * float(np.median(known) ** 2) if len(known) else 0.0
