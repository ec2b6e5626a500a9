"""Limits of the current from a recorded load cycle, in the method's five steps (ch. 2.3.2, fig. 2.8 and 2.9).

1. a representative cycle, 2. its histogram, 3. the intervals' edges as lower and upper limits, 4. each for as long as
the interval's share of the time, 5. all of it scaled by a limitation ratio that depends on the state of charge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.design.constraints.limitation import LimitationRatio
from models.design.constraints.limits import CurrentBounds, InfeasibleError, Window

N_INTERVALS = 12
# Each interval's time is cut into pieces of about this length, so that charge and discharge alternate.
PIECE_S = 60.0
# Long enough for the middle time constants to build up within one amplitude.
_LEVEL_PIECE_S = 60.0


@dataclass(frozen=True)
class LoadHistogram:
    """How often a load cycle draws which current.

    Attributes
    ----------
    edges_A : (n + 1,) rising edges of the intervals
    share : (n,) of the time in each interval
    """

    edges_A: FloatArray
    share: FloatArray

    def mean_A(self) -> float:
        """Mean current if every interval is used in its middle."""
        return float(self.share @ (0.5 * (self.edges_A[:-1] + self.edges_A[1:])))


def load_histogram(
    cycle_A: FloatArray, n_intervals: int = N_INTERVALS, duration_s: FloatArray | None = None
) -> LoadHistogram:
    """Steps 1 to 3: the intervals of a cycle and their shares of its time.

    Parameters
    ----------
    cycle_A : (n,) the recorded current
    n_intervals : of equal width
    duration_s : (n,) how long each value holds; by default all alike

    Raises
    ------
    ModelError
        The cycle has no two different finite currents.
    """
    known = np.isfinite(cycle_A)
    if n_intervals < 2 or known.sum() < 2 or not np.ptp(cycle_A[known]) > 0.0:
        raise ModelError("load cycle: two different currents and two intervals are needed for a histogram")
    weights = np.ones(len(cycle_A)) if duration_s is None else duration_s
    time_s, edges = np.histogram(cycle_A[known], n_intervals, weights=weights[known])
    return LoadHistogram(edges, time_s / time_s.sum())


def load_cycle_bounds(
    histogram: LoadHistogram,
    n_samples: int,
    dt_s: float,
    current_A: Window,
    ratio: LimitationRatio,
    rng: np.random.Generator,
) -> CurrentBounds:
    """Steps 4 and 5: limits of each sample.

    Parameters
    ----------
    histogram : of the load cycle
    n_samples, dt_s : of the experiment
    current_A : the cell's own limits; the cycle is scaled into them as a whole where it exceeds them
    ratio : limitation ratio over the state of charge
    rng : breaks ties in the order of the intervals

    Returns
    -------
    CurrentBounds

    Notes
    -----
    The text leaves the order of the intervals open. Here pieces of about a minute follow each other so that the charge
    counted in their middles stays as small as it can, which leaves the state of charge where the block is to be.
    """
    edges = _scaled_edges(histogram, current_A)
    counts = _apportion(histogram.share, n_samples)
    order, lengths = _interleave(counts, 0.5 * (edges[:-1] + edges[1:]), max(1, round(PIECE_S / dt_s)), rng)
    low, high = np.repeat(edges[order], lengths), np.repeat(edges[order + 1], lengths)
    if (low > high).any():
        raise InfeasibleError("load cycle: its scaled intervals are empty")
    return CurrentBounds(low, high, ratio.soc, ratio.discharge, ratio.charge)


def mean_current_range(histogram: LoadHistogram, current_A: Window) -> Window:
    """Range of the mean current within a histogram's intervals, in A: how far they let a block move the charge."""
    edges = _scaled_edges(histogram, current_A)
    return float(histogram.share @ edges[:-1]), float(histogram.share @ edges[1:])


def _scaled_edges(histogram: LoadHistogram, current_A: Window) -> FloatArray:
    scale = min(
        1.0,
        current_A[0] / histogram.edges_A[0] if histogram.edges_A[0] < 0.0 else 1.0,
        current_A[1] / histogram.edges_A[-1] if histogram.edges_A[-1] > 0.0 else 1.0,
    )
    return scale * histogram.edges_A


def amplitude_bounds(
    levels: tuple[float, ...], n_samples: int, dt_s: float, current_A: Window, rng: np.random.Generator
) -> CurrentBounds:
    """Limits that change between shares of the largest current, each for the same time, in pieces in random order.

    Parameters
    ----------
    levels : shares, within 0..1
    n_samples, dt_s : of the experiment
    current_A : largest currents
    rng : orders the pieces
    """
    if not levels or not all(0.0 < level <= 1.0 for level in levels):
        raise ModelError("amplitude levels: at least one share above 0 and up to 1 is needed")
    piece = max(1, min(round(_LEVEL_PIECE_S / dt_s), n_samples // len(levels)))
    count = -(-n_samples // piece)
    shares = rng.permutation(np.resize(np.asarray(levels, np.float64), count))
    share = np.repeat(shares, piece)[:n_samples]
    return CurrentBounds(share * current_A[0], share * current_A[1])


def _apportion(share: FloatArray, n_samples: int) -> np.ndarray:
    """Whole samples by shares, largest remainders first."""
    exact = share * n_samples
    counts = np.floor(exact).astype(int)
    for i in np.argsort(counts - exact, kind="stable")[: n_samples - int(counts.sum())]:
        counts[i] += 1
    return counts


def _interleave(
    counts: np.ndarray, middle_A: FloatArray, piece: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Order pieces of the intervals so that the running charge stays small."""
    left, charge = counts.copy(), 0.0
    order, lengths = [], []
    total_A = float(counts @ middle_A) / max(int(counts.sum()), 1)
    while left.any():
        ready = np.flatnonzero(left)
        take = np.minimum(left[ready], piece)
        # Against the cycle's own mean, which no order removes.
        after = np.abs(charge + take * (middle_A[ready] - total_A))
        pick = int(ready[np.argmin(after * (1.0 + 0.3 * rng.uniform(size=len(ready))))])
        length = int(min(left[pick], piece))
        charge += length * (middle_A[pick] - total_A)
        left[pick] -= length
        order.append(pick)
        lengths.append(length)
    return np.array(order), np.array(lengths)
