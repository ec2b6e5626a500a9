"""Whether what is taken for a constant of the sensors has stood still while it was estimated.

A filter that is told of a constant comes to be as sure of it as its model says. Where the log is not what the model
takes it for (rests cut out, time counted anew, a current that was not logged), the estimate follows each of these
faults with a narrow band. That it moved is seen: an estimate of a constant differs from its own past by no more than
its variance has fallen since (Anderson and Moore, "Optimal Filtering", 1979, ch. 5).
"""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.observer.filter import places

_COLUMNS = {"current_offset_A": places.OFFSET_OUT, "capacity_Ah": places.CAPACITY_OUT}
_UNITS = {"current_offset_A": ("offset of the current sensor", 1e3, "mA"), "capacity_Ah": ("capacity", 1.0, "Ah")}
# Standard deviations that an estimate may be off what it is later.
_EXPECTED = 3.0
# A band of two standard deviations takes in every place where the estimate has been beyond that.
_BAND = 2.0
# A band that has grown by this much is told.
_TOLD = 3.0

Told = dict[str, dict[str, float] | None]


def wandered(values: FloatArray, std: FloatArray) -> float:
    """How far an estimate was, at the most, from where it ended, beyond what was to be expected.

    Parameters
    ----------
    values, std : (N,) over a run
    """
    expected = _EXPECTED * np.sqrt(np.maximum(std**2 - std[-1] ** 2, 0.0))
    return float(np.max(np.abs(values - values[-1]) - expected, initial=0.0))


def with_honest_bands(told: Told, rows: FloatArray) -> tuple[Told, list[str]]:
    """Widen the bands of sensor values that did not stand still.

    Parameters
    ----------
    told : what the observer says at the end of a run
    rows : (N, columns) what it said on the way

    Returns
    -------
    told, remarks
    """
    found, remarks = dict(told), []
    for name, place in _COLUMNS.items():
        value = told.get(name)
        if value is None:
            continue
        moved = wandered(rows[:, place], rows[:, place + 1])
        std = float(np.hypot(value["std"], moved / _BAND))
        found[name] = value | {"std": std}
        if std > _TOLD * value["std"]:
            what, factor, unit = _UNITS[name]
            remarks.append(
                f"the {what} did not stand still while it was estimated (by up to {factor * moved:.3g} {unit}): its "
                "band is widened; rests or samples may be missing from the log, or the model does not fit"
            )
    return found, remarks
