"""The test that tells two rival models apart, each refitted (T-optimal: Atkinson and Fedorov, Biometrika 62, 1975).

What one rival predicts and the other cannot, however its parameters are moved within what is known of them:
T = min over c of |y_A - y_B - Psi_B c|^2 / noise^2 + c' R c, with R the information that the data so far give on B, and
the same with A and B exchanged. The mean of the logarithms is maximised: neither direction alone decides.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.design.information.experiment import Evaluator, Experiment

# Added to a separation, in noise variances: rivals that agree exactly have one of 0, whose logarithm is none.
_FLOOR = 1e-9


class _Refitted(NamedTuple):
    """What refitting a rival leaves: squared distance, remaining difference, and how the parameters move."""

    separation: float
    left_V: FloatArray
    moved: FloatArray
    begin: int  # number of the first parameter that is moved


class RivalEvaluator:
    """Separation of two rivals and its gradient; stands in for `Evaluator` in an ascent.

    Parameters
    ----------
    first, second : the rivals, at the same sampling time and from the same state of charge
    n_samples : length of the current
    """

    def __init__(self, first: Experiment, second: Experiment, n_samples: int) -> None:
        if first.network.structure.dt_s != second.network.structure.dt_s:
            raise ModelError(
                f"rivals have sampling times of {first.network.structure.dt_s:g} s and "
                f"{second.network.structure.dt_s:g} s; they must be the same"
            )
        self._evaluators = (Evaluator(first, n_samples), Evaluator(second, n_samples))
        self._noise_V = first.working_V
        self._last: tuple[FloatArray, list[_Refitted]] | None = None

    def value(self, current_A: FloatArray) -> float:
        """Mean log separation of a current; larger is better."""
        parts = self._parts(current_A)
        self._last = (current_A, parts)
        return 0.5 * sum(float(np.log(separation + _FLOOR)) for separation, *_ in parts)

    def gradient(self) -> FloatArray:
        """(N,) derivative to the current whose value was asked for last, in 1/A."""
        if self._last is None:
            raise ModelError("a gradient follows a value")
        current_A, parts = self._last
        total = np.zeros(len(current_A))
        for refitted, (separation, left, moved, begin) in enumerate(parts):
            # By the envelope theorem the refit itself needs no derivative: left = difference - Psi c.
            weight = 1.0 / ((separation + _FLOOR) * self._noise_V**2)
            own, other = self._evaluators[refitted], self._evaluators[1 - refitted]
            total += other.voltage_gradient(current_A, weight * left)
            total += own.voltage_gradient(current_A, -weight * left, -weight * np.outer(left, moved), begin)
        return total

    def separation(self, current_A: FloatArray) -> tuple[float, float]:
        """Squared distance in noise variances that refitting the second, and the first, rival leaves."""
        first_refitted, second_refitted = self._parts(current_A)
        return second_refitted.separation, first_refitted.separation

    def _parts(self, current_A: FloatArray) -> list[_Refitted]:
        """With the first, then the second rival refitted."""
        predictions = [evaluator.touched(current_A) for evaluator in self._evaluators]
        out = []
        for refitted in (0, 1):
            difference = predictions[1 - refitted].voltage_V - predictions[refitted].voltage_V
            psi, prior = predictions[refitted].sensitivity_V, predictions[refitted].prior
            matrix = psi.T @ psi / self._noise_V**2 + prior
            moved = cho_solve(cho_factor(matrix), psi.T @ difference / self._noise_V**2)
            left = difference - psi @ moved
            separation = float(left @ left / self._noise_V**2 + moved @ prior @ moved)
            out.append(_Refitted(separation, left, moved, predictions[refitted].begin))
        return out
