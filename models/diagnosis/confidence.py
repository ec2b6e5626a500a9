"""How sure a named effect is: a probability calibrated on cases whose truth was known."""

from __future__ import annotations

import numpy as np

# Logistic regression of "the named effect is right" on the logarithm of the margin to the best rival.
_OFFSET, _SLOPE = 0.8, 1.2
_MARGIN_UNIT = 1.0
_LEAST_MARGIN, _MOST = 0.005, 0.99


def confidence(margin: float, n_rivals: int) -> float:
    """Probability that a named effect is right.

    Parameters
    ----------
    margin : by how much the best rival's remaining error is larger, relative
    n_rivals : effects that the data cannot tell from it
    """
    logit = _OFFSET + _SLOPE * np.log(max(margin, _LEAST_MARGIN) / _MARGIN_UNIT)
    sure = 1.0 / (1.0 + np.exp(-logit))
    return float(min(sure, _MOST, 1.0 / (1.0 + n_rivals) + 0.1 if n_rivals else _MOST))
