"""Resistance of the first moment: the voltage one sample after a step of the current, over the current."""

from __future__ import annotations

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.effects.view import ModelInputs
from models.network.signals import RunSignals


def quick_rows(cell: KnownCell, run: GridRun, soc: FloatArray) -> FloatArray:
    """(n, P) derivatives of that resistance in Ohm to the cell's coefficients in V.

    Parameters
    ----------
    cell : as it was
    run : whose direction, usual current and temperature the step has
    soc : (n,) at which
    """
    size_A = float(np.sqrt(np.mean(run.current_A**2))) * (1.0 if float(np.mean(run.current_A)) > 0.0 else -1.0)
    known = run.temperature_degC[np.isfinite(run.temperature_degC)]
    degC = float(np.mean(known)) if len(known) else cell.trained_degC
    source = RunSignals(np.array([0.0, size_A]), np.full(2, degC), np.zeros(2), cell.dt_s, cell.capacity_Ah)
    signals = cell.signals(source, np.array([0, 1]))
    step = np.repeat((signals[:, 1] - signals[:, 0])[:, None], len(soc), axis=1)
    rows = cell.regressors(ModelInputs(np.zeros(len(soc)), step), soc)
    rows[:, : cell.layout.n_curve] = 0.0
    return rows / size_A
