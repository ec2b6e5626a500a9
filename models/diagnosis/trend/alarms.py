"""False alarms over a series: how strong the evidence of a run must be, one among many.

Wang and Ramdas, "False discovery rate control with e-values", J. R. Statist. Soc. B 84 (2022) 822, section 3: for odds
whose mean under "nothing new" is at most one, however they depend on each other, claiming the k largest of n where the
k-th is at least n / (k alpha) keeps the expected share of false claims below alpha. Likelihood ratios are such odds,
and so are their powers below one.
"""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray


def claimed(nothing: FloatArray, prior: float, alarms: float) -> np.ndarray:
    """(n,) whether something may be said of a run.

    Parameters
    ----------
    nothing : (n,) probability of "nothing new" of each run, alone
    prior : the same before anything was measured
    alarms : share of false claims that is let through
    """
    order = np.argsort(nothing, kind="stable")
    least = np.maximum(nothing[order], 1e-300)
    odds = (1.0 - least) / least * prior / (1.0 - prior)
    enough = odds >= len(order) / (np.arange(1, len(order) + 1) * alarms)
    out = np.zeros(len(order), dtype=bool)
    if enough.any():
        out[order[: int(np.flatnonzero(enough)[-1]) + 1]] = True
    return out
