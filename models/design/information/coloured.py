"""What a test tells where the errors that a fit leaves hang together in time and differ in size.

A fit by least squares weighs all samples alike. With X the sensitivities, s the variance that it is made to count with,
O the covariance of the errors and P what is known beforehand, its estimate has the covariance H^-1 M H^-1 with H = P +
X'X / s and M = P + X'OX / s^2: the sandwich of Newey and West, Econometrica 55, 1987. What is given back is its
inverse, which for white errors of variance s is H itself.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from models.data.timeseries import FloatArray
from models.design.information.experiment import Evaluator, Experiment
from models.uncertainty.covariance import PairedProducts


def told_information(experiment: Experiment, current_A: FloatArray) -> FloatArray:
    """(M p, M p) information after an experiment, prior included, of a fit by least squares."""
    return next(told_over_time(experiment, current_A, np.array([len(current_A)])))


def told_over_time(experiment: Experiment, current_A: FloatArray, ends: np.ndarray) -> Iterator[FloatArray]:
    """Information after the first `ends` samples of a current, one matrix after the other."""
    evaluator = Evaluator(experiment, len(current_A))
    if experiment.memory is None:
        yield from evaluator.information_over_time(current_A, ends)
        return
    rows = evaluator.predict(current_A).sensitivity_V
    weighed = rows * evaluator.level_V()[:, None]
    prior, s, before = experiment.prior_information(), experiment.working_V**2, 0
    plain, paired = np.zeros_like(prior), PairedProducts(experiment.memory, len(prior))
    for end in ends:
        part = slice(before, int(end))
        plain += rows[part].T @ rows[part]
        paired.add(weighed[part])
        before = int(end)
        whole = prior + plain / s
        yield whole @ cho_solve(cho_factor(prior + paired.total() / s**2, lower=True), whole)
