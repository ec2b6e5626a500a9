"""Sizes of effects: those that a change cannot have, and what few training runs leave open of them.

A loop cannot be narrower than none, nor a film be made thinner by charge. How much runs of a cell differ is learned
from its training runs; of few it is known so badly that a size lies further off than its standard deviation says, as
often as Student's distribution has it. Nor does a cell follow an effect's equation to the letter, and another
explanation that has the effect may give it another size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import erfcx, log_ndtr, ndtri, stdtrit

from models.data.timeseries import FloatArray
from models.diagnosis.known.elsewhere import Elsewhere
from models.diagnosis.likelihood.background import Background, Weighed, log_sum
from models.diagnosis.likelihood.thresholds import THRESHOLDS

# Part of a variance that an edge can take at the most.
_MOST_NARROWED = 1.0 - 1e-9
# Two standard deviations either way, which hold 95 %.
_WITHIN = 0.975


def possible(weighed: Weighed, least: float, column: int = 0) -> tuple[Weighed, float]:
    """Sizes of which one cannot be less than so much, and what that adds to the logarithm of their evidence.

    The normal distribution that the runs leave is cut off there (Johnson, Kotz and Balakrishnan, Continuous univariate
    distributions 1, 1994, ch. 13.10). What is added is the logarithm of how much of it can be, over how much could
    before the runs were looked at: something at the edge of what can be is no evidence, however well it fits beyond.

    Parameters
    ----------
    weighed : sizes as if they could be anything
    least : the smallest that can be, in units of the usual one; minus infinity: anything
    column : which of the sizes
    """
    if np.isneginf(least):
        return weighed, 0.0
    std = float(np.sqrt(weighed.covariance[column, column]))
    edge = (least - float(weighed.mean[column])) / std
    before = log_sum(log_ndtr(-least / np.array(THRESHOLDS.sizes))) - float(np.log(len(THRESHOLDS.sizes)))
    log_left = float(log_ndtr(-edge))
    # Density at the edge over what is left beyond it.
    hazard = float(np.sqrt(2.0 / np.pi) / erfcx(edge / np.sqrt(2.0)))
    along = weighed.covariance[:, column] / std
    mean = weighed.mean + along * hazard
    mean[column] = max(mean[column], least)
    # Far beyond the edge the difference is lost to rounding; something is always left open.
    narrower = min(max(hazard * (hazard - edge), 0.0), _MOST_NARROWED)
    covariance = weighed.covariance - narrower * np.outer(along, along)
    return replace(weighed, mean=mean, covariance=covariance), log_left - before


def doubt(elsewhere: Elsewhere) -> float:
    """Factor of the learned differences with which two standard deviations hold 95 % of what runs will show.

    1 where nothing differs from run to run. A single run counts as two: its parts differ, too.
    """
    if not elsewhere.granted:
        return 1.0
    runs = len(np.unique(elsewhere.known.run))
    return float(stdtrit(max(runs - 1, 1), _WITHIN) / ndtri(_WITHIN))


def widened(
    back: Background, weighed: Weighed, columns: FloatArray, moved: FloatArray | None, factor: float
) -> Weighed:
    """Sizes with what few training runs leave open of them, and what an effect's equation does.

    Parameters
    ----------
    back : error and covariance
    weighed : sizes
    columns, moved : (N, k), (N,) that they were found with
    factor : of the learned differences
    """
    equation = THRESHOLDS.equation**2 * np.outer(weighed.mean, weighed.mean)
    return replace(weighed, covariance=weighed.covariance + back.less_sure(columns, moved, factor) + equation)


def averaged(found: Weighed, chance: float, others: Sequence[tuple[float, Weighed]]) -> Weighed:
    """Sizes with what is open of them because another explanation that has the effect would give it others.

    The covariance about the sizes of the explanation that is told, over all explanations by their probability (Hoeting
    et al., Statist. Sci. 14, 1999).

    Parameters
    ----------
    found, chance : sizes in the explanation that is told, and its probability
    others : probability and sizes of each other one
    """
    covariance, total = chance * found.covariance, chance
    for p, other in others:
        away = other.mean - found.mean
        covariance = covariance + p * (other.covariance + np.outer(away, away))
        total += p
    return replace(found, covariance=covariance / total) if others else found
