"""State of charge from counted charge."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray


def soc_by_counting(
    charge_Ah: FloatArray, initial_soc: float, capacity_Ah: float, efficiency: float = 1.0
) -> FloatArray:
    """State of charge from counted charge.

    Parameters
    ----------
    charge_Ah : (n,) charge counted from the start, positive: charged
    initial_soc : fraction 0..1
    capacity_Ah : cell capacity in Ah
    efficiency : coulombic efficiency that applies to charging

    Returns
    -------
    (n,) fraction

    Notes
    -----
    Unger, Kozek, Jakubek, "Energy Efficient Non-Road Hybrid Electric Vehicles", ch. 2, eq. 2.32 and 2.33.
    """
    if efficiency == 1.0:
        return initial_soc + charge_Ah / capacity_Ah
    step = np.diff(charge_Ah, prepend=charge_Ah[0])
    return initial_soc + np.cumsum(np.where(step > 0, efficiency * step, step)) / capacity_Ah
