"""Resistance of the first moment: the voltage one sample after a step of the current, over the current."""

from __future__ import annotations

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.known.elsewhere import Points
from models.diagnosis.known.thresholds import KNOWN
from models.effects.view import ModelInputs
from models.network.signals import RunSignals, arrhenius

_SMALL_SOC = 5e-3


def quick_rows(cell: KnownCell, run: GridRun, soc: FloatArray) -> FloatArray:
    """(n, P) derivatives of that resistance in Ohm to the cell's coefficients in V.

    Parameters
    ----------
    cell : as it was
    run : whose direction, usual current and temperature the step has
    soc : (n,) at which
    """
    size_A, degC = usual_step(cell, run)
    source = RunSignals(np.array([0.0, size_A]), np.full(2, degC), np.zeros(2), cell.dt_s, cell.capacity_Ah)
    signals = cell.signals(source, np.array([0, 1]))
    step = np.repeat((signals[:, 1] - signals[:, 0])[:, None], len(soc), axis=1)
    rows = cell.regressors(ModelInputs(np.zeros(len(soc)), step), soc)
    rows[:, : cell.layout.n_curve] = 0.0
    return rows / size_A


def usual_step(cell: KnownCell, run: GridRun) -> tuple[float, float]:
    """A run's usual current in A, in its direction, and its temperature in degC."""
    size_A = float(np.sqrt(np.mean(run.current_A**2))) * (1.0 if float(np.mean(run.current_A)) > 0.0 else -1.0)
    known = run.temperature_degC[np.isfinite(run.temperature_degC)]
    return size_A, float(np.mean(known)) if len(known) else cell.trained_degC


def step_points(cell: KnownCell, run: GridRun, soc: FloatArray) -> Points:
    """(2 n,) operating points one sample after such a step, and then those without it.

    Parameters
    ----------
    cell : as it was
    run : whose direction, usual current and temperature the step has
    soc : (n,) at which
    """
    size_A, degC = usual_step(cell, run)
    scaled = size_A * float(arrhenius(np.array([degC]), KNOWN.rate_activation_K)[0]) / cell.capacity_Ah
    quick = [1.0, *(1.0 - np.exp(-cell.dt_s / tau_s) for tau_s in KNOWN.rate_s)]
    n = len(soc)
    rates = np.vstack([np.tile(scaled * np.array(quick), (n, 1)), np.zeros((n, len(quick)))])
    slope = (cell.open_circuit_V(soc + _SMALL_SOC) - cell.open_circuit_V(soc - _SMALL_SOC)) / (2.0 * _SMALL_SOC)
    still = np.zeros(2 * n)
    return Points(still - 1.0, still, np.tile(soc, 2), still + degC, rates, np.tile(slope, 2), still)
