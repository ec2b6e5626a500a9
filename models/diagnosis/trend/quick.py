"""Resistance of the first moment: the voltage one sample after a step of the current, over the current."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.known.elsewhere import Points
from models.diagnosis.known.thresholds import KNOWN
from models.effects.view import ModelInputs
from models.identification.bounded.terms import BEHIND
from models.network.signals import RunSignals, arrhenius

_SMALL_SOC = 5e-3
# Temperatures that differ by less than this in K are one.
_SAME_K = 0.2


@dataclass(frozen=True)
class Steps:
    """Steps of a run's usual current, at rest before, at some states of charge.

    Attributes
    ----------
    soc : (n,)
    current_A : after each, in the run's direction
    temperature_degC : (n,) that the run has at the same state of charge, or next to it
    """

    soc: FloatArray
    current_A: float
    temperature_degC: FloatArray


def steps_of(cell: KnownCell, run: GridRun, soc: FloatArray, counted: FloatArray) -> Steps:
    """Steps as a run has them.

    Parameters
    ----------
    cell : as it was
    run : on its grid
    soc : (n,) at which
    counted : (N,) state of charge of the run
    """
    size_A = float(np.sqrt(np.mean(run.current_A**2))) * (1.0 if float(np.mean(run.current_A)) > 0.0 else -1.0)
    degC = np.where(np.isnan(run.temperature_degC), cell.trained_degC, run.temperature_degC)
    nearest = np.argmin(np.abs(counted[None, :] - soc[:, None]), axis=1)
    return Steps(soc, size_A, degC[nearest])


def quick_rows(cell: KnownCell, steps: Steps) -> FloatArray:
    """(n, P) derivatives of that resistance in Ohm to the cell's coefficients in V."""
    # Over the few kelvins of a run all signals bend so little with temperature that three values tell them.
    low, high = float(steps.temperature_degC.min()), float(steps.temperature_degC.max())
    if high - low < _SAME_K:
        at, shares = np.array([0.5 * (low + high)]), np.ones((len(steps.soc), 1))
    else:
        at = np.array([low, 0.5 * (low + high), high])
        shares = _parabola((steps.temperature_degC - low) / (high - low))
    signals = shares @ np.array([_after_step(cell, steps.current_A, degC) for degC in at.tolist()])
    # The curve is left out below; what stands behind its surface belongs to it.
    signals[:, cell.terms_of(BEHIND)] = 0.0
    rows = cell.regressors(ModelInputs(np.zeros(len(steps.soc)), signals.T), steps.soc)
    rows[:, : cell.layout.n_curve] = 0.0
    return rows / steps.current_A


def _after_step(cell: KnownCell, current_A: float, degC: float) -> FloatArray:
    """(B,) what the signals change by in the first sample of a step."""
    source = RunSignals(np.array([0.0, current_A]), np.full(2, degC), np.zeros(2), cell.dt_s, cell.capacity_Ah)
    both = cell.signals(source, np.array([0, 1]))
    return both[:, 1] - both[:, 0]


def _parabola(x: FloatArray) -> FloatArray:
    """(n, 3) weights of values at 0, 0.5 and 1 for those at places between."""
    return np.column_stack([(1.0 - x) * (1.0 - 2.0 * x), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)])


def step_points(cell: KnownCell, steps: Steps) -> Points:
    """(2 n,) operating points one sample after each step, and then those without it."""
    soc, n = steps.soc, len(steps.soc)
    scaled = steps.current_A * arrhenius(steps.temperature_degC, KNOWN.rate_activation_K) / cell.capacity_Ah
    quick = [1.0, *(1.0 - np.exp(-cell.dt_s / tau_s) for tau_s in KNOWN.rate_s)]
    rates = np.vstack([np.outer(scaled, quick), np.zeros((n, len(quick)))])
    slope = (cell.open_circuit_V(soc + _SMALL_SOC) - cell.open_circuit_V(soc - _SMALL_SOC)) / (2.0 * _SMALL_SOC)
    still = np.zeros(2 * n)
    return Points(
        still - 1.0, still, np.tile(soc, 2), np.tile(steps.temperature_degC, 2), rates, np.tile(slope, 2), still
    )
