"""The state of charge at which a run begins, as far as its own columns tell."""

from __future__ import annotations

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import TimeSeries

# Charge before the reference SoC is known, over the range of the run's counted charge.
_UNSEEN_SHARE = 0.005


def start_soc(run: TimeSeries) -> float:
    """Return the first reference SoC of a run.

    Raises
    ------
    ModelError
        The run has none, or only after charge has flowed; the message says how to give one.
    """
    if run.soc_ref is not None:
        known = np.flatnonzero(~np.isnan(run.soc_ref))
        if len(known):
            check_known_from_start(run, int(known[0]))
            return float(run.soc_ref[known[0]])
    raise ModelError(f"{run.name}: its initial SoC is not known (no soc_ref column); give it with --initial-soc")


def check_known_from_start(run: TimeSeries, first: int) -> None:
    """Refuse a reference SoC that begins only after charge has flowed: it is not that of the run's start.

    Parameters
    ----------
    run : as measured
    first : sample of the first known reference

    Raises
    ------
    ModelError
        The message says from when on the SoC is known, and what flowed before.
    """
    flowed_Ah = np.cumsum(np.nan_to_num(run.current_A[1:]) * np.diff(run.time_s)) / 3600.0
    before_Ah = float(flowed_Ah[first - 1]) if first > 0 else 0.0
    if abs(before_Ah) > _UNSEEN_SHARE * max(float(np.ptp(flowed_Ah)), 1e-12):
        raise ModelError(
            f"{run.name}: its SoC is known only from {run.time_s[first] - run.time_s[0]:g} s on, when {before_Ah:.3g} "
            "Ah had flowed already; cut the run there, or give the SoC of its first sample with --initial-soc"
        )
