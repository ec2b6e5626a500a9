"""Into how many parts the runs' temperatures can be divided."""

from __future__ import annotations

import numpy as np

from models.network.regression import SignalBank
from models.network.signals.temperature_scale import MOVING_K
from models.network.structure import TEMPERATURE_PARTS

# Of all samples, in each part.
_LEAST_SHARE = 0.01


def temperature_parts(bank: SignalBank) -> int:
    """Into how many equal parts the runs' temperatures can be divided so that each of them was measured in.

    Of a part that no run was in nothing is known: between runs at 10 and 40 degC alone its model was 0.2 V off.
    """
    if bank.span_K < MOVING_K:
        return 1
    every = np.concatenate([run.temperature_degC for run in bank.runs])
    known = every[~np.isnan(every)]
    for parts in range(TEMPERATURE_PARTS, 1, -1):
        if np.histogram(known, parts)[0].min() >= _LEAST_SHARE * len(known):
            return parts
    return 1
