"""Does positive current charge in this file? The voltage tells.

A cell's voltage rises at once when the current rises in charging direction (it is a resistance), and rises slowly
while charge flows in. A file of the opposite convention shows both the other way round.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Verdict = Literal["charge-positive", "discharge-positive", "unclear"]

# Steps of current at least this share of the largest one are evidence; smaller ones drown in noise.
_STEP_SHARE = 0.3
_NO_STEP_SHARE = 0.02
_SCALE_RANK = 5
_MOST_STEPS = 5000
_FEWEST_STEPS = 3
# Share of agreeing minus disagreeing steps (weighted by their size) from which the answer is clear.
_CLEAR = 0.5
# A slow answer (no steps): the voltage's whole movement must stand out of noise, in V.
_SLOW_RANGE_V = 0.05


@dataclass(frozen=True, slots=True)
class SignEvidence:
    """What the voltage says about the sign of the current, and why."""

    verdict: Verdict
    text: str


def judge_sign(
    current_A: NDArray[np.float64], voltage_V: NDArray[np.float64], time_s: NDArray[np.float64]
) -> SignEvidence:
    """Compare current and voltage.

    Parameters
    ----------
    current_A, voltage_V, time_s : (n,) NaN where missing

    Returns
    -------
    SignEvidence
        `unclear` where there is no current, no step and no slow movement, or where they contradict each other.
    """
    known = ~(np.isnan(current_A) | np.isnan(voltage_V))
    current, voltage, time = current_A[known], voltage_V[known], time_s[known]
    if len(current) < _FEWEST_STEPS or not np.any(current):
        return SignEvidence("unclear", "no current flows")
    fast = _from_steps(current, voltage)
    return fast if fast.verdict != "unclear" else _from_charge(current, voltage, time, fast.text)


def _from_steps(current: NDArray[np.float64], voltage: NDArray[np.float64]) -> SignEvidence:
    step_A, step_V = np.diff(current), np.diff(voltage)
    size = np.abs(step_A)
    steps = np.sort(size[size > _NO_STEP_SHARE * float(np.max(np.abs(current)))])
    if len(steps) == 0:
        return SignEvidence("unclear", "the current has no steps")
    # A spike in the log makes two steps that the voltage knows nothing of: the fifth largest says what is large.
    large = float(steps[-min(_SCALE_RANK, len(steps))])
    step_A = np.clip(step_A, -2.0 * large, 2.0 * large)
    chosen = np.flatnonzero(size >= _STEP_SHARE * large)
    if len(chosen) > _MOST_STEPS:
        chosen = chosen[np.argpartition(size[chosen], -_MOST_STEPS)[-_MOST_STEPS:]]
    if len(chosen) < _FEWEST_STEPS:
        return SignEvidence("unclear", f"only {len(chosen)} step(s) of current")
    product = step_A[chosen] * step_V[chosen]
    weight = float(np.sum(np.abs(product)))
    if weight == 0.0:
        return SignEvidence("unclear", "the voltage does not answer the steps of current")
    score = float(np.sum(product)) / weight
    against = int(np.sum(product < 0))
    if abs(score) < _CLEAR:
        return SignEvidence("unclear", f"{against} of {len(chosen)} current steps move the voltage the other way")
    resistance_Ohm = float(np.median(step_V[chosen] / step_A[chosen]))
    if score < 0:
        return SignEvidence(
            "discharge-positive",
            f"at {against} of the {len(chosen)} largest current steps the voltage moves against the current "
            f"(median {resistance_Ohm * 1000:+.3g} mV/A)",
        )
    return SignEvidence("charge-positive", f"median {resistance_Ohm * 1000:+.3g} mV/A at {len(chosen)} steps")


def _from_charge(
    current: NDArray[np.float64], voltage: NDArray[np.float64], time: NDArray[np.float64], otherwise: str
) -> SignEvidence:
    # Backward hold: value k flowed in the interval that ends at k.
    charge = np.cumsum(current * np.diff(time, prepend=time[0]))
    if np.ptp(charge) == 0.0 or np.ptp(voltage) < _SLOW_RANGE_V:
        return SignEvidence("unclear", otherwise)
    correlation = float(np.corrcoef(charge, voltage)[0, 1])
    if abs(correlation) < _CLEAR:
        return SignEvidence("unclear", otherwise)
    if correlation < 0:
        return SignEvidence(
            "discharge-positive",
            f"the voltage falls while charge is counted up (correlation {correlation:+.2f})",
        )
    return SignEvidence("charge-positive", f"the voltage rises with counted charge (correlation {correlation:+.2f})")
