"""What may have changed in a cell, as weights of columns: capacity, resistance, curve, slip and loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.trend.settings import SETTINGS, USUAL, Sizes
from models.effects.view import View
from models.identification.bounded.knots import hats

_N = SETTINGS.nodes
NODES = np.linspace(0.0, 1.0, _N)
CAPACITY = slice(0, 1)
QUICK = slice(1, 1 + _N)
SLOWER = slice(QUICK.stop, QUICK.stop + _N)
CURVE = slice(SLOWER.stop, SLOWER.stop + _N)
SLIP = slice(CURVE.stop, CURVE.stop + _N)
LOOP = slice(SLIP.stop, SLIP.stop + 1)
SHIFT = slice(LOOP.stop, LOOP.stop + 1)
SERIES = slice(SHIFT.stop, SHIFT.stop + 1)
OVERALL = slice(SERIES.stop, SERIES.stop + 1)
COUNT = OVERALL.stop
# Share of the variance of resistances that is alike at every state of charge.
_COMMON = 0.5
# Rate at which a loop's place is left, over the capacity.
_LOOP_RATE = 40.0


@dataclass(frozen=True)
class Latent:
    """Columns of a run for weights in units of their own.

    Attributes
    ----------
    volts : (m, COUNT - 1) V of all but the capacity: resistances over SoC relative to `usual_Ohm` and to their own,
        then V, SoC, V and SoC, then a resistance relative to `KnownCell.typical_Ohm`, and all relative to their own
    usual_Ohm : of the first moment
    """

    volts: FloatArray
    usual_Ohm: float


def latent(view: View, slope_V: FloatArray, usual_Ohm: float) -> Latent:
    """Make them.

    Parameters
    ----------
    view : run and samples
    slope_V : (m,) of the open-circuit curve, per SoC of 1
    usual_Ohm : resistance of the first moment
    """
    current_A = view.run.current_A
    here = hats(NODES, np.clip(view.soc[view.index], 0.0, 1.0))
    quick = usual_Ohm * here * current_A[view.index][:, None]
    slower = here * view.overvoltage(current_A)[:, None]
    # The same at all states of charge: what a clamp has, and all by one factor.
    alike = np.column_stack([view.model.typical_Ohm * current_A[view.index], view.overvoltage(current_A)])
    loop = view.hysteresis(_LOOP_RATE)[:, None]
    slip = here * slope_V[:, None]
    return Latent(np.hstack([quick, slower, here, slip, loop, slope_V[:, None], alike]), usual_Ohm)


def root(sizes: Sizes) -> FloatArray:
    """(COUNT, COUNT) root of the weights' covariance."""
    out = np.zeros((COUNT, COUNT))
    out[CAPACITY, CAPACITY] = sizes.capacity
    out[QUICK, QUICK] = sizes.resistance * _ROOTS["resistance"]
    out[SLOWER, SLOWER] = sizes.slower * _ROOTS["resistance"]
    out[CURVE, CURVE] = sizes.curve_V * _ROOTS["curve"]
    out[SLIP, SLIP] = sizes.slip * _ROOTS["slip"]
    out[LOOP, LOOP] = sizes.loop_V
    out[SHIFT, SHIFT] = sizes.shift
    out[SERIES, SERIES] = sizes.series
    out[OVERALL, OVERALL] = sizes.overall
    return out


def resistances(fresh_Ohm: FloatArray, usual: float, typical: float) -> FloatArray:
    """(n, COUNT) Ohm that each weight changes the resistances of the first moment by, one for each node.

    Parameters
    ----------
    fresh_Ohm : (n,) as they were
    usual, typical : that they are relative to, over SoC and where they are the same everywhere
    """
    out = np.zeros((len(fresh_Ohm), COUNT))
    out[:, QUICK] = usual * np.eye(len(out))
    out[:, SLOWER] = np.diag(fresh_Ohm)
    out[:, SERIES] = typical
    out[:, OVERALL] = fresh_Ohm[:, None]
    return out


def usual_Ohm(fresh_Ohm: FloatArray, cell: KnownCell) -> float:
    """Resistance of the first moment by which changes are measured; never nothing."""
    return max(float(np.median(np.abs(fresh_Ohm))), 0.05 * cell.typical_Ohm, 1e-9)


def _root_of(length: float, common: float) -> FloatArray:
    apart = (NODES[:, None] - NODES[None, :]) / length
    values, vectors = np.linalg.eigh(common + (1.0 - common) * np.exp(-0.5 * apart**2))
    return vectors * np.sqrt(np.maximum(values, 0.0))


_ROOTS = {
    "resistance": _root_of(SETTINGS.alike_soc, _COMMON),
    "curve": _root_of(SETTINGS.curve_soc, 0.0),
    "slip": _root_of(SETTINGS.slip_soc, 0.0),
}
# Root of the covariance by which what is usual differs between two runs.
DIFFERENT = np.sqrt(2.0) * root(USUAL)
