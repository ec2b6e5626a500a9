"""dQ/dV and dV/dQ of a measured and of a simulated voltage over the same charge, on the same axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.data.stretches import stretches
from models.data.timeseries import FloatArray
from models.readouts.incremental import incremental

# Widths of the bins, and the full width at half height of the bell by which they are smoothed, in bins.
_STEP_V, _STEP_SHARE, _WIDTH_STEPS = 2.5e-3, 2.5e-3, 4.0
_TO_STD = 1.0 / 2.3548
# A way shorter than this, over the capacity, shows no electrode's stages; nor does one with a current above this, 1/h.
_LEAST_SHARE, _FASTEST = 0.3, 1.2
_LEAST_SAMPLES = 100
# What passed in a longer pause of the log is left out.
_GAP_S = 300.0

Values = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Beside:
    """Curves of the longest way in one direction of the current; the first row is measured, the second simulated.

    Attributes
    ----------
    way : "charge" or "discharge"
    rate : mean current over the capacity, 1/h
    voltage_V, dQ_dV_Ah_per_V : shape (n,), (2, n)
        NaN where a voltage never came.
    charge_Ah, dV_dQ_V_per_Ah : shape (k,), (2, k)
        Charge since the start of the run.
    width_V, width_Ah : full width at half height of the smoothing
    """

    way: str
    rate: float
    voltage_V: Values
    dQ_dV_Ah_per_V: Values
    charge_Ah: Values
    dV_dQ_V_per_Ah: Values
    width_V: float
    width_Ah: float


def beside(
    time_s: FloatArray,
    current_A: FloatArray,
    charge_Ah: FloatArray,
    voltages_V: tuple[FloatArray, FloatArray],
    capacity_Ah: float,
) -> list[Beside]:
    """Return the curves of the longest charge and of the longest discharge, as far as these are long and slow enough.

    Parameters
    ----------
    time_s, current_A, charge_Ah : shape (n,)
        Of the run; charge counted into the cell.
    voltages_V : measured, NaN where it is missing, and simulated, shape (n,) each
    capacity_Ah : of the cell
    """
    known = np.isfinite(voltages_V[0]) & np.isfinite(voltages_V[1])
    time_s, current_A, charge_Ah = (np.asarray(each[known], np.float64) for each in (time_s, current_A, charge_Ah))
    after_gap = np.diff(time_s, prepend=time_s[:1]) > _GAP_S
    both_V = [np.where(after_gap, np.nan, each[known]) for each in voltages_V]
    found = []
    for way, sign in (("charge", 1.0), ("discharge", -1.0)):
        part = _longest(sign * current_A >= 0.0, charge_Ah)
        moved_Ah = abs(float(np.ptp(charge_Ah[part]))) if part.stop - part.start >= _LEAST_SAMPLES else 0.0
        loaded_h = float(np.sum(np.diff(time_s[part])[sign * current_A[part][1:] > 0.0])) / 3600.0
        rate = moved_Ah / capacity_Ah / max(loaded_h, 1e-9)
        if moved_Ah < _LEAST_SHARE * capacity_Ah or rate > _FASTEST:
            continue
        steps = (_STEP_V, _STEP_SHARE * capacity_Ah)
        own = [incremental(each[part], charge_Ah[part], *steps).get(way) for each in both_V]
        if own[0] is None or own[1] is None:
            continue
        voltage_V, dQ_dV = _together([(each.voltage_V, each.dQ_dV_Ah_per_V) for each in own if each], steps[0])
        places_Ah, dV_dQ = _together([(each.charge_Ah, each.dV_dQ_V_per_Ah) for each in own if each], steps[1])
        widths = (_WIDTH_STEPS * steps[0], _WIDTH_STEPS * steps[1])
        found.append(Beside(way, rate, voltage_V, dQ_dV, places_Ah, dV_dQ, *widths))
    return found


def _longest(allowed: NDArray[np.bool_], charge_Ah: Values) -> slice:
    """The stretch without interruption over which most charge moves."""
    found = stretches(allowed)
    if not found:
        return slice(0, 0)
    return slice(*max(found, key=lambda each: abs(charge_Ah[each[1] - 1] - charge_Ah[each[0]])))


def _together(curves: list[tuple[Values, Values]], step: float) -> tuple[Values, Values]:
    """Curves whose bins lie on the same raster, smoothed, over all that they span together."""
    low, high = min(x[0] for x, _ in curves), max(x[-1] for x, _ in curves)
    count = round((high - low) / step) + 1
    rows = np.full((len(curves), count), np.nan)
    for row, (x, y) in zip(rows, curves, strict=True):
        first = round((x[0] - low) / step)
        row[first : first + len(y)] = y
    return low + step * np.arange(count), np.array([_smoothed(row) for row in rows])


def _smoothed(values: Values) -> Values:
    """Smoothed by a bell; what is missing stays so, and weighs nothing."""
    std = _WIDTH_STEPS * _TO_STD
    reach = round(3.0 * std)
    bell = np.exp(-0.5 * (np.arange(-reach, reach + 1) / std) ** 2)
    known = np.isfinite(values)
    total = np.convolve(np.where(known, values, 0.0), bell, mode="full")[reach : reach + len(values)]
    weight = np.convolve(known.astype(np.float64), bell, mode="full")[reach : reach + len(values)]
    return np.where(known, total / np.maximum(weight, 1e-12), np.nan)
