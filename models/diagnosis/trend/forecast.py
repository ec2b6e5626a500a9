"""When a capacity reaches a stated end: a line whose slope wanders, with all that is open of it.

The slope is a Wiener process, so the capacity is an integrated one (Wahba, J. R. Statist. Soc. B 40, 1978: a smoothing
spline): how much the slope wandered between the runs tells how much it may wander after them, and the band grows with
the power 3/2 of the distance. Nothing is told further beyond the runs than they span.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import ndtr

from models.data.errors import ModelError
from models.data.timeseries import FloatArray

FEWEST = 4
# Wander of the slope over the whole series, in units of the whole capacity, and scatter of a run, relative; the lines
# that they stand for are weighed by how likely they make the runs.
_WANDER = np.geomspace(3e-3, 1.0, 9)
_SCATTER = np.geomspace(1e-3, 3e-2, 7)
# Loss over the series that a line may have without any run to say so, and what the first capacity may be off.
_SLOPE, _START = 0.5, 0.1
_POINTS = 60
_TWO_SIDED = 0.025


@dataclass(frozen=True)
class Forecast:
    """Capacity over the life of a cell, and when it ends.

    Attributes
    ----------
    unit : of the places of runs, such as "cycle"
    end_Ah : capacity that is the end
    place, capacity_Ah, low_Ah, high_Ah : (p,) the curve with its 95 % band
    at, low, high : place where the end is reached, and 95 % band; None: not within reach of the runs
    last : place of the last run
    """

    unit: str
    end_Ah: float
    place: FloatArray
    capacity_Ah: FloatArray
    low_Ah: FloatArray
    high_Ah: FloatArray
    at: float | None
    low: float | None
    high: float | None
    last: float

    @property
    def reached(self) -> bool:
        """Whether the runs themselves show the end."""
        return self.at is not None and self.at <= self.last

    @property
    def words(self) -> str:
        """What a person is told."""
        end = f"{self.end_Ah:.3g} Ah"
        if self.at is None:
            told = "" if self.low is None else f" it may be from {self.unit} {self.low:.0f} on, but"
            return f"{end}:{told} when is not within the data: they reach to {self.unit} {self.place[-1]:.0f} at most"
        to = f"later than {self.place[-1]:.0f}" if self.high is None else f"{self.high:.0f}"
        since = f"{self.unit} {self.place[0]:.0f}" if self.low is None else f"{self.low:.0f}"
        verb = "was reached" if self.reached else "is expected, if it goes on as it did,"
        return f"{end} {verb} at {self.unit} {self.at:.0f}, 95 % between {since} and {to}"

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types."""
        every = zip(self.place, self.capacity_Ah, self.low_Ah, self.high_Ah, strict=True)
        return {
            "unit": self.unit,
            "end_Ah": self.end_Ah,
            "at": self.at,
            "low": self.low,
            "high": self.high,
            "reached": self.reached,
            "within_data": self.at is not None,
            "explanation": self.words,
            "curve": [
                {"at": float(x), "capacity_Ah": float(c), "low_Ah": float(lo), "high_Ah": float(hi)}
                for x, c, lo, hi in every
            ],
        }


def forecast(place: FloatArray, capacity_Ah: FloatArray, fresh_Ah: float, end: float, unit: str) -> Forecast | None:
    """Follow a capacity over runs and beyond; None where too few places are known.

    Parameters
    ----------
    place : (n,) of the runs along the life, never falling
    capacity_Ah : (n,)
    fresh_Ah : capacity of the cell as it was
    end : share of it that is the end
    unit : of the places

    Raises
    ------
    ModelError
        The places fall.
    """
    if np.any(np.diff(place) < 0.0):
        k = int(np.flatnonzero(np.diff(place) < 0.0)[0])
        raise ModelError(
            f"run {k + 2} is at {unit} {place[k + 1]:g}, after one at {place[k]:g}: give runs in time's order"
        )
    where, number = np.unique(place, return_inverse=True)
    if len(where) < FEWEST:
        return None
    count = np.bincount(number).astype(np.float64)
    mean = np.bincount(number, weights=capacity_Ah) / count / fresh_Ah
    span = float(where[-1] - where[0])
    x = (where - where[0]) / span
    far = np.linspace(0.0, 2.0, _POINTS)
    means, stds, share = _lines(x, mean, count, far)
    middle = share @ means
    low, high = (_level(means, stds, share, each) for each in (_TWO_SIDED, 1.0 - _TWO_SIDED))
    # What was lost does not come back.
    below = np.maximum.accumulate(share @ ndtr((end - means) / stds))

    def first(least: float) -> float | None:
        """Place from which on the end is reached with a probability."""
        if below[-1] < least:
            return None
        last = int(np.searchsorted(below, least)) - 1
        if last < 0:
            return float(where[0])
        part = (least - below[last]) / max(below[last + 1] - below[last], 1e-12)
        return float(where[0] + span * (far[last] + part * (far[last + 1] - far[last])))

    return Forecast(
        unit,
        end * fresh_Ah,
        where[0] + span * far,
        fresh_Ah * middle,
        fresh_Ah * low,
        fresh_Ah * high,
        first(0.5),
        first(_TWO_SIDED),
        first(1.0 - _TWO_SIDED),
        float(where[-1]),
    )


def _lines(
    x: FloatArray, y: FloatArray, count: FloatArray, far: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(h, p) means and standard deviations of every line, and (h,) how likely each is."""
    means, stds, logs = [], [], []
    line = _START**2 + _SLOPE**2 * np.outer(x, x)
    across = _START**2 + _SLOPE**2 * np.outer(far, x)
    whole = _START**2 + _SLOPE**2 * far**2
    bent, bent_across, bent_far = _integrated(x, x), _integrated(far, x), far**3 / 3.0
    for wander, scatter in product(_WANDER, _SCATTER):
        factor = cho_factor(line + wander**2 * bent + np.diag(scatter**2 / count), lower=True)
        solved = cho_solve(factor, y - 1.0)
        k = across + wander**2 * bent_across
        variance = whole + wander**2 * bent_far - np.einsum("pn,np->p", k, cho_solve(factor, k.T))
        logs.append(-0.5 * float((y - 1.0) @ solved) - float(np.sum(np.log(np.diag(factor[0])))))
        means.append(1.0 + k @ solved)
        stds.append(np.sqrt(np.maximum(variance, 1e-12)))
    share = np.exp(np.array(logs) - max(logs))
    return np.array(means), np.array(stds), share / share.sum()


def _integrated(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, m) covariance of an integrated Wiener process that begins at 0."""
    less = np.minimum(a[:, None], b[None, :])
    return less**3 / 3.0 + np.abs(a[:, None] - b[None, :]) * less**2 / 2.0


def _level(means: FloatArray, stds: FloatArray, share: FloatArray, probability: float) -> FloatArray:
    """(p,) value below which the capacity lies with a probability."""
    low, high = (means - 6.0 * stds).min(axis=0), (means + 6.0 * stds).max(axis=0)
    for _ in range(40):
        middle = 0.5 * (low + high)
        under = share @ ndtr((middle - means) / stds) < probability
        low, high = np.where(under, middle, low), np.where(under, high, middle)
    return 0.5 * (low + high)
