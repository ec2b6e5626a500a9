"""Incremental capacity dQ/dV and its inverse dV/dQ of a measured run, by counting.

Charge is counted into bins of voltage, and voltage averaged over bins of charge, so that no noisy signal is
differentiated sample by sample (Dubarry, Truchot and Liaw, J. Power Sources 219, 2012, for what the peaks mean).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# One wild value must not ask for bins without end.
_MOST_BINS = 20_000


@dataclass(frozen=True, slots=True)
class Incremental:
    """Both curves of one direction of the current; voltages and charges are those of the bins' centres.

    Attributes
    ----------
    voltage_V, dQ_dV_Ah_per_V : shape (n_voltage,)
        Positive in either direction; 0 where no charge moved.
    charge_Ah, dV_dQ_V_per_Ah : shape (n_charge,)
        Between neighbouring bins of charge; NaN where one of them was never passed.
    """

    voltage_V: NDArray[np.float64]
    dQ_dV_Ah_per_V: NDArray[np.float64]
    charge_Ah: NDArray[np.float64]
    dV_dQ_V_per_Ah: NDArray[np.float64]


def incremental(
    voltage_V: NDArray[np.float64], charge_Ah: NDArray[np.float64], step_V: float, step_Ah: float
) -> dict[str, Incremental]:
    """Return the curves of ``charge`` and ``discharge``, each where the run has any.

    Parameters
    ----------
    voltage_V, charge_Ah : shape (n,)
        Measured voltage, NaN where it is missing, and charge counted into the cell.
    step_V, step_Ah : positive
        Widths of the bins.
    """
    moved_Ah = np.diff(charge_Ah)
    middle_V, middle_Ah = (voltage_V[1:] + voltage_V[:-1]) / 2.0, (charge_Ah[1:] + charge_Ah[:-1]) / 2.0
    found = {}
    for name, way in (("charge", moved_Ah > 0.0), ("discharge", moved_Ah < 0.0)):
        rows = way & np.isfinite(middle_V)
        if rows.any():
            found[name] = _curves(middle_V[rows], middle_Ah[rows], np.abs(moved_Ah[rows]), step_V, step_Ah)
    return found


def _curves(
    middle_V: NDArray[np.float64],
    middle_Ah: NDArray[np.float64],
    moved_Ah: NDArray[np.float64],
    step_V: float,
    step_Ah: float,
) -> Incremental:
    step_V = max(step_V, float(np.ptp(middle_V)) / _MOST_BINS)
    step_Ah = max(step_Ah, float(np.ptp(middle_Ah)) / _MOST_BINS)
    first, bins = _bins(middle_V, step_V)
    moved = np.bincount(bins, moved_Ah)
    at, places = _bins(middle_Ah, step_Ah)
    share = np.bincount(places, moved_Ah)
    with np.errstate(invalid="ignore"):
        mean_V = np.bincount(places, moved_Ah * middle_V) / share
        mean_Ah = np.bincount(places, moved_Ah * middle_Ah) / share
        slope = np.diff(mean_V) / np.diff(mean_Ah)
    return Incremental(
        voltage_V=first + step_V * np.arange(len(moved), dtype=np.float64),
        dQ_dV_Ah_per_V=moved / step_V,
        charge_Ah=at + step_Ah * (np.arange(len(slope), dtype=np.float64) + 0.5),
        dV_dQ_V_per_Ah=slope,
    )


def _bins(values: NDArray[np.float64], step: float) -> tuple[float, NDArray[np.intp]]:
    """Centre of the first bin, and the bin of each value."""
    number = np.floor(values / step).astype(np.intp)
    lowest = int(number.min())
    return step * (lowest + 0.5), number - lowest
