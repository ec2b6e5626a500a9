"""State of charge by counting what a run has measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SECONDS_PER_HOUR = 3600.0


def counted_soc(
    time_s: NDArray[np.float64], current_A: NDArray[np.float64], initial_soc: float, capacity_Ah: float
) -> NDArray[np.float64]:
    """Count charge over the samples of a run.

    Parameters
    ----------
    time_s, current_A : arrays, shape (n,)
        At least one sample. A current is that of the interval that ends with it (backward hold); a missing one
        counts as none. Positive current charges.
    initial_soc : float
        State of charge at the first sample, 0..1.
    capacity_Ah : float

    Returns
    -------
    numpy.ndarray, shape (n,)
        State of charge as a fraction; errors of current and capacity may carry it beyond 0..1.
    """
    charge_As = np.concatenate([[0.0], np.cumsum(np.nan_to_num(current_A[1:]) * np.diff(time_s))])
    return initial_soc + charge_As / (_SECONDS_PER_HOUR * capacity_Ah)
