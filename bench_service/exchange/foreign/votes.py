"""Does positive current charge? Where steps of current are few: each step and each long stage has a vote.

A step of current moves the voltage its own way at once; a stage of constant current moves it slowly. A voltage that is
held (CV) does not move, and votes for nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench_service.exchange.foreign.spool import Spool
from bench_service.exchange.sign import SignEvidence, judge_sign

_STEP_SHARE, _REST_SHARE, _SAME_SHARE = 0.3, 0.02, 0.02
_STEP_V, _STAGE_V, _NOISE = 0.003, 0.008, 5.0
_CLEAR = 0.5
_BOTH, _LONG_SHARE = 0.15, 0.1
# A longer record is looked at in windows: sign, as opposed to shape, is the same everywhere.
_WHOLE, _WINDOW, _WINDOWS = 1_000_000, 25_000, 24


@dataclass(frozen=True, slots=True)
class Votes:
    """Volts by which the voltage moved with the current, and against it.

    Attributes
    ----------
    for_V, against_V : at steps and over stages
    long_for_V, long_against_V : over stages alone that crossed a good part of the voltage's range
    """

    for_V: float
    against_V: float
    long_for_V: float = 0.0
    long_against_V: float = 0.0

    def __add__(self, other: Votes) -> Votes:
        """Count two together."""
        return Votes(
            self.for_V + other.for_V,
            self.against_V + other.against_V,
            self.long_for_V + other.long_for_V,
            self.long_against_V + other.long_against_V,
        )

    @property
    def score(self) -> float:
        """From -1 (all against) to +1."""
        total = self.for_V + self.against_V
        return (self.for_V - self.against_V) / total if total > 0.0 else 0.0

    @property
    def both(self) -> bool:
        """Whether the voltage does both: charge and discharge with one sign of the current."""
        return _are_both(self.for_V, self.against_V)

    @property
    def surely_both(self) -> bool:
        """Whether it does so over long stages, which a drive cycle's noise does not look like."""
        return _are_both(self.long_for_V, self.long_against_V)


def _are_both(one_V: float, other_V: float) -> bool:
    return min(one_V, other_V) > _BOTH * (one_V + other_V) > 0.0


def votes(current_A: NDArray[np.float64], voltage_V: NDArray[np.float64]) -> Votes:
    """Count what the voltage did at steps of current and over stages of constant current.

    Parameters
    ----------
    current_A, voltage_V : (n,) NaN where missing
    """
    known = ~(np.isnan(current_A) | np.isnan(voltage_V))
    current, voltage = current_A[known], voltage_V[known]
    if len(current) < 2 or not np.any(current):
        return Votes(0.0, 0.0)
    largest = float(np.max(np.abs(current)))
    step_A, step_V = np.diff(current), np.diff(voltage)
    noise_V = _NOISE * float(np.median(np.abs(step_V - np.median(step_V))))
    steps = np.flatnonzero(np.abs(step_A) >= _STEP_SHARE * largest)
    moved = step_V[steps] * np.sign(step_A[steps])
    moved = moved[np.abs(moved) >= max(_STEP_V, noise_V)]
    stages = _stages(current, voltage, _SAME_SHARE * largest, _REST_SHARE * largest)
    stages = stages[np.abs(stages) >= max(_STAGE_V, noise_V)]
    long = stages[np.abs(stages) >= _LONG_SHARE * float(np.ptp(voltage))]
    both = np.concatenate([moved, stages])
    return Votes(*(float(sign * each[sign * each > 0].sum()) for each in (both, long) for sign in (1, -1)))


def _stages(
    current: NDArray[np.float64], voltage: NDArray[np.float64], same_A: float, rest_A: float
) -> NDArray[np.float64]:
    """(m,) V by which each stage of steady current moved the voltage, counted in the direction of the current.

    A stage begins one row after its current does: the step itself is not part of it.
    """
    ends = np.flatnonzero(np.abs(np.diff(current)) > same_A)
    first = np.concatenate([[0], ends + 1])
    last = np.concatenate([ends, [len(current) - 1]])
    long = last - first >= 2
    first, last = first[long] + 1, last[long]
    flows = np.abs(current[first]) > rest_A
    first, last = first[flows], last[flows]
    return (voltage[last] - voltage[first]) * np.sign(current[first])


def judge_spool(spool: Spool, keep: NDArray[np.bool_]) -> tuple[SignEvidence, Votes]:
    """Ask the voltage of a whole record, or of windows spread over it; rows that are left out have no say."""
    windows = [(0, spool.n)]
    if spool.n > _WHOLE:
        starts = np.linspace(0, spool.n - _WINDOW, _WINDOWS).astype(int)
        windows = [(int(start), int(start) + _WINDOW) for start in starts]
    verdicts: list[SignEvidence] = []
    counted = Votes(0.0, 0.0)
    for start, stop in windows:
        kept = keep[start:stop]
        time, current, voltage = (
            spool.column(name, start, stop)[kept] for name in ("time_s", "current_A", "voltage_V")
        )
        verdicts.append(judge_sign(current, voltage, time))
        counted += votes(current, voltage)
    clear = [each for each in verdicts if each.verdict != "unclear"]
    agree = len({each.verdict for each in clear}) == 1
    opposite = agree and abs(counted.score) >= _CLEAR and (clear[0].verdict == "charge-positive") != (counted.score > 0)
    if agree and not opposite:
        return clear[0], counted
    text = f"the voltage moved {counted.for_V:.3g} V with the current and {counted.against_V:.3g} V against it"
    if opposite:
        return SignEvidence("unclear", f"{clear[0].text}, but {text}"), counted
    if counted.score >= _CLEAR:
        return SignEvidence("charge-positive", text), counted
    if counted.score <= -_CLEAR:
        return SignEvidence("discharge-positive", text), counted
    return SignEvidence("unclear", verdicts[0].text if counted.for_V + counted.against_V == 0.0 else text), counted
