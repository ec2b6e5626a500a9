"""How sure a named effect is: a probability calibrated on cases whose truth was known."""

from __future__ import annotations

import numpy as np

from models.diagnosis.evidence.ranking import Ranking

# Logistic curve of "the named effect is right" over the logarithm of the margin to the best rival, the most likely one
# for the 226 findings without rivals of `benchmarks/diagnosis_change.py` (seeds 100..103) and `diagnosis_structure.py`
# (100, 101).
_OFFSET, _SLOPE = 1.6, 0.52
_LEAST_MARGIN, _MOST = 0.005, 0.985
# Where all effects together leave more than this times the noise, the cell is not of the class that this was calibrated
# on; what holds there is known in change mode only (`change_answer`), and taken from there.
AS_NOISE, SURE_ELSEWHERE = 1.5, 0.85
# Up to this factor a cell is surely of that class; between the two nothing is a step, for folds cut otherwise move the
# factor by some hundredths.
_SURELY = 1.3
# Of two that one log can hardly tell apart, little more than half are named right.
_MOST_WITH_RIVALS = 0.6


def confidence(ranking: Ranking) -> float:
    """Probability that the effect named from the voltage is right."""
    sure = _probability(ranking.margin, len(ranking.rivals))
    return sure if ranking.own_V <= AS_NOISE * ranking.noise_V else min(sure, SURE_ELSEWHERE)


def of_rivals(sure: float, n_rivals: int) -> float:
    """Probability of each rival of a named effect: they share what that leaves, and none is likelier than it."""
    return min(sure, (1.0 - sure) / n_rivals) if n_rivals else 0.0


def most_sure(factor: float) -> float:
    """How sure anything may be said of a cell whose unseen error is so many times the noise."""
    return float(np.interp(factor, [_SURELY, AS_NOISE], [1.0, SURE_ELSEWHERE]))


def _probability(margin: float, n_rivals: int) -> float:
    logit = _OFFSET + _SLOPE * np.log(max(margin, _LEAST_MARGIN))
    sure = 1.0 / (1.0 + np.exp(-logit))
    return float(min(sure, _MOST_WITH_RIVALS if n_rivals else _MOST))
