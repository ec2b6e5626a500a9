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


def lasting(said: np.ndarray, alone: FloatArray, together: FloatArray, prior: float, claim: float) -> np.ndarray:
    """(n,) whether something may be said of a run, what lasts from earlier runs included.

    What a run bears out is there in later ones as well, where the series as a whole says so and they lean to it.

    Parameters
    ----------
    said : (n,) of `claimed`
    alone, together : (n,) probability of "nothing new" by each run alone, and by all of them
    prior : the same before anything was measured
    claim : largest probability of "nothing new" by all runs of one of which something is said
    """
    out = said.copy()
    first = np.flatnonzero(said)
    if len(first):
        later = np.arange(len(said)) > first[0]
        out |= later & (together < claim) & (alone < prior)
    return out
