"""Samples of an error that are written down."""

import numpy as np

from models.comparison.samples import ErrorSamples


def samples(n: int) -> ErrorSamples:
    """1 mV everywhere, a second apart, in a cell of 2 Ah that is discharged at 1C after every hundredth second."""
    index = np.arange(n)
    return ErrorSamples(
        error_V=np.full(n, 1e-3),
        soc=np.full(n, 0.5),
        c_rate=np.full(n, -1.0),
        temperature_degC=np.full(n, 25.0),
        direction=np.full(n, -1.0),
        since_step_s=(index % 100).astype(float),
        throughput_Ah=2.0 * index / 3600.0,
        progress=index / n,
        capacity_Ah=2.0,
        total_s=float(n),
    )
