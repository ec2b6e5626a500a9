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
# A voltage that a charger holds does not answer the current, whatever its last digits do: V, and in units of noise.
_ANSWER_V, _ANSWER_NOISE = 0.003, 4.0
# Samples by which the voltage may be logged after the current, or before: in a drive cycle one of them turns the sign.
_LAGS = (0, 1, -1, 2, -2)
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
    slow = _from_charge(current, voltage, time, fast.text)
    if fast.verdict == "unclear":
        return slow
    if slow.verdict not in ("unclear", fast.verdict):
        return SignEvidence("unclear", f"steps of current say one thing ({fast.text}), charge another ({slow.text})")
    return fast


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
    answer_V = max(_ANSWER_V, _ANSWER_NOISE * _noise_V(step_V, size < _NO_STEP_SHARE * large))
    return max((_at_lag(step_A, step_V, chosen, lag, answer_V) for lag in _LAGS), key=lambda each: each[0])[1]


def _at_lag(
    step_A: NDArray[np.float64], step_V: NDArray[np.float64], chosen: NDArray[np.intp], lag: int, answer_V: float
) -> tuple[float, SignEvidence]:
    """How much is answered with the voltage's steps so many samples after the current's, in W; and the answer.

    That much is the power of the steps times how far they agree: of the few steps at a wrong distance all may agree.
    """
    at = chosen[(chosen + lag >= 0) & (chosen + lag < len(step_V))]
    at = at[np.abs(step_V[at + lag]) >= answer_V]
    if len(at) < _FEWEST_STEPS:
        return 0.0, SignEvidence("unclear", "the voltage does not answer the steps of current")
    amperes, volts = step_A[at], step_V[at + lag]
    product = amperes * volts
    score = float(np.sum(product)) / float(np.sum(np.abs(product)))
    answered_W, against = abs(score * float(np.sum(product))), int(np.sum(product < 0))
    if abs(score) < _CLEAR:
        text = f"{against} of {len(at)} current steps move the voltage the other way"
        return answered_W, SignEvidence("unclear", text)
    resistance_Ohm = float(np.median(volts / amperes))
    if score < 0:
        text = (
            f"at {against} of the {len(at)} largest current steps the voltage moves against the current "
            f"(median {resistance_Ohm * 1000:+.3g} mV/A)"
        )
        return answered_W, SignEvidence("discharge-positive", text)
    return answered_W, SignEvidence("charge-positive", f"median {resistance_Ohm * 1000:+.3g} mV/A at {len(at)} steps")


def _noise_V(step_V: NDArray[np.float64], still: NDArray[np.bool_]) -> float:
    """Typical step of the voltage while the current stands still, for as long as the two may be apart."""
    wide = 2 * max(_LAGS) + 1
    quiet_V = step_V[np.convolve(still, np.ones(wide), mode="same") > wide - 0.5] if len(still) > wide else step_V[:0]
    return float(np.median(np.abs(quiet_V))) if len(quiet_V) else 0.0


def _from_charge(
    current: NDArray[np.float64], voltage: NDArray[np.float64], time: NDArray[np.float64], otherwise: str
) -> SignEvidence:
    # Backward hold: value k flowed in the interval that ends at k.
    charge = np.cumsum(current * np.diff(time, prepend=time[0]))
    if np.ptp(charge) == 0.0 or np.ptp(voltage) < _SLOW_RANGE_V:
        return SignEvidence("unclear", otherwise)
    # Beside the current: a charge in falling stages has a falling voltage, where the curve is flat.
    moved, beside = _apart(voltage, current), _apart(charge, current)
    size = float(np.linalg.norm(moved) * np.linalg.norm(beside))
    correlation = float(moved @ beside) / size if size > 0.0 else 0.0
    if abs(correlation) < _CLEAR:
        return SignEvidence("unclear", otherwise)
    if correlation < 0:
        return SignEvidence(
            "discharge-positive",
            f"the voltage falls while charge is counted up (correlation {correlation:+.2f})",
        )
    return SignEvidence("charge-positive", f"the voltage rises with counted charge (correlation {correlation:+.2f})")


def _apart(values: NDArray[np.float64], current: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) values without their mean and without what goes with the current."""
    values, current = values - values.mean(), current - current.mean()
    power = float(current @ current)
    return values - (float(values @ current) / power) * current if power > 1e-12 * len(current) else values
