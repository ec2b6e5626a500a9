"""An open-circuit curve that rises at every trained temperature and on either branch of the hysteresis loop.

The curve's increments are bounded at 25 degC and in the middle of the loop. Its slope with temperature and the loop's
width change along the state of charge, so that elsewhere it could fall where it is flat. Where it would, the fall is
penalised until it is gone (the quadratic penalty method: Nocedal and Wright, "Numerical Optimization", 2006, ch. 17.1),
and what rounding leaves is put right by raising increments.
"""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.identification.bounded.box_least_squares import Solution, solve
from models.identification.bounded.knots import hats
from models.identification.bounded.layout import REFERENCE_DEGC, Layout
from models.identification.bounded.strengths import HeldOut, penalty
from models.identification.bounded.terms import BEHIND
from models.network.signals import parse_signal

_ROUNDS = 12
# Of a squared fall beside the mean squared error: the fall that is left is as much smaller than the error's slope.
_WEIGHT = 30.0
_SETTLED_V = 1e-5


def rising(held: HeldOut, logs: tuple[float, ...], temperature_degC: tuple[float, float]) -> FloatArray:
    """(P,) coefficients, the curve by its first value and its increments.

    Parameters
    ----------
    held : sums, the curve given by its increments
    logs : strengths of the penalties
    temperature_degC : range in which the curve has to rise
    """
    sums, count = held.sums, float(held.sums.count.sum())
    matrix, right = sums.xx.sum(axis=0) / count + penalty(sums, logs), sums.xy.sum(axis=0) / count
    return risen(matrix, right, sums.layout, held.whole(logs), temperature_degC)


def risen(
    matrix: FloatArray, right: FloatArray, layout: Layout, found: Solution, temperature_degC: tuple[float, float]
) -> FloatArray:
    """(P,) the same from the equations of a mean squared error, whose solution without the further bounds is known."""
    rises = corner_increments(layout, temperature_degC)
    before = np.zeros(len(rises), dtype=bool)
    for _ in range(_ROUNDS):
        steps = rises @ found.x
        falling = steps < (0.0 if before.any() else -_SETTLED_V)
        if (falling == before).all():
            break
        broken = rises[falling]
        found = solve(matrix + _WEIGHT * broken.T @ broken, right, layout.box, found.side)
        before = falling
    out = found.x.copy()
    missing = np.maximum(-(rises @ out).reshape(-1, layout.n_curve - 1).min(axis=0), 0.0)
    out[1 : layout.n_curve] += missing
    # The whole curve is not to be lifted by what was added along it.
    out[0] -= 0.5 * float(missing.sum())
    return out


def corner_increments(layout: Layout, temperature_degC: tuple[float, float]) -> FloatArray:
    """(corners (n - 1), P) increments of the open-circuit curve at both temperatures, on both branches."""
    knots, n = layout.knots.soc, layout.n_curve
    slope, loop = np.zeros((n - 1, layout.size)), np.zeros((n - 1, layout.size))
    slope_scale, curve = 1.0, np.eye(n - 1, layout.size, k=1)
    for b, term in enumerate(layout.basis.terms):
        part = slice(int(layout.first[b]), int(layout.first[b + 1]))
        steps = np.diff(hats(knots[layout.places(b)], knots), axis=0)
        if not term.bounded:
            slope[:, part], slope_scale = steps, float(layout.scale[b])
        elif parse_signal(term.signal).kind == "hysteresis_state":
            # Its ends are -1 and 1, whether the runs reached them or not.
            loop[:, part] = steps / float(layout.scale[b])
        elif parse_signal(term.signal).kind == BEHIND:
            # What is left at the surface has to rise as well: its gain is a slope.
            curve[:, part] = -np.diff(knots)[:, None] / float(layout.scale[b])
    away = {(degC - REFERENCE_DEGC) / slope_scale for degC in (*temperature_degC, REFERENCE_DEGC)}
    return np.vstack([curve + share * slope + side * loop for share in away for side in (-1.0, 1.0)])
