"""How sure a named effect is: a probability calibrated on cases whose truth was known."""

from __future__ import annotations

import numpy as np

# Logistic regression of "the named effect is right" on the logarithm of the margin to the best rival, over the 100
# cases named from the voltage of `benchmarks/diagnosis_change.py --cases 60 --first-seed 200 --null-share 0.15` and
# `--cases 100 --first-seed 1000`.
_OFFSET, _SLOPE = 1.25, 0.32
_LEAST_MARGIN, _MOST = 0.005, 0.99
# Of 23 cases with rivals 16 were right.
_MOST_WITH_RIVALS = 0.6


def confidence(margin: float, n_rivals: int) -> float:
    """Probability that a named effect is right.

    Parameters
    ----------
    margin : by how much the best rival's remaining error is larger; below 1 the two cannot be told apart
    n_rivals : effects that the data cannot tell from it
    """
    logit = _OFFSET + _SLOPE * np.log(max(margin, _LEAST_MARGIN))
    sure = 1.0 / (1.0 + np.exp(-logit))
    return float(min(sure, _MOST_WITH_RIVALS if n_rivals else _MOST))
