"""A bounded network solved without a word on where its runs begin.

What flowed before a run's first sample leaves branches that die out with time and a place in the hysteresis loop that
is left with the charge that flows. A fit that takes each run for one that begins at rest puts that down to its curve
and gains, and then nothing looks wrong. Here each run has transients of its own beside the network, with a wide prior,
and they are eliminated (the Schur complement of the normal equations: Boyd and Vandenberghe, "Convex Optimization",
2004, app. C.4): what is left is what the runs say of the cell whatever flowed before.
"""

from __future__ import annotations

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.identification.bounded.fitted import BoundedFit, solved_fit
from models.identification.bounded.layout import counted, soc_over
from models.identification.bounded.problem import Sums, blocks, make_sums, regressors, rest_weights, run_index
from models.identification.bounded.strengths import HeldOut

# Time constants of what dies out, and rates of what the loop forgets with the charge over the capacity: those of the
# network's terms, each second one; the ones between are sums of their neighbours to a few percent.
_DECAYS_S = (6.0, 30.0, 150.0, 600.0, 2000.0)
_FORGETTING = (10.0, 60.0)
# How large a transient may be: of the order of a cell's overvoltage.
_LIKELY_V = 0.05
# Samples that tell where the starts are; more of them tell nothing new.
_SAMPLES = 60_000


def with_open_starts(fit: BoundedFit) -> BoundedFit:
    """The same form with the same strengths, solved while each run's transients at its start are open."""
    n_samples = sum(len(run) for run in fit.bank.runs)
    sums = _open_sums(fit, max(1, round(n_samples / _SAMPLES)))
    return solved_fit(fit.bank, fit.variant, HeldOut(sums.by_increments()), fit.log_strengths)


def transients(run: GridRun, capacity_Ah: float) -> FloatArray:
    """(n, k) what may be left of what flowed before a run, each 1 at its first sample."""
    time_s = run.dt_s * np.arange(len(run))
    moved = np.cumsum(np.abs(run.current_A)) * run.dt_s / 3600.0 / capacity_Ah
    decays = [np.exp(-time_s / tau_s) for tau_s in _DECAYS_S if tau_s > run.dt_s]
    return np.column_stack([*decays, *(np.exp(-rate * moved) for rate in _FORGETTING)])


def _open_sums(fit: BoundedFit, keep_every: int) -> Sums:
    """Sums of all samples as one fold, transients eliminated."""
    bank, layout = fit.bank, fit.layout
    voltage, run_of = np.concatenate([run.voltage_V for run in bank.runs]), run_index(bank)
    weight = rest_weights(bank)
    sums = make_sums(bank, layout, keep_every, np.zeros(len(voltage), dtype=np.int64), weight)
    chosen = counted(voltage, keep_every)
    rows, soc = regressors(bank, layout.basis, layout.scale, chosen), np.concatenate(soc_over(bank, layout.basis.axis))
    soc, voltage, run_of = soc[chosen], voltage[chosen], run_of[chosen]
    ridge = fit.held_out_rmse_V**2 / _LIKELY_V**2
    before = 0
    for number, run in enumerate(bank.runs):
        own = np.flatnonzero(run_of == number)
        made = transients(run, bank.cell.capacity_Ah)[chosen[own] - before]
        heavy = weight[chosen[own]][:, None] * made
        before += len(run)
        cross = np.zeros((made.shape[1], layout.size))
        for part, block, columns in blocks(layout, rows, soc, own):
            cross[:, columns] += heavy[np.searchsorted(own, part)].T @ block
        right = heavy.T @ voltage[own]
        gone = np.linalg.solve(heavy.T @ made + ridge * np.eye(made.shape[1]), np.column_stack([cross, right]))
        sums.xx[0] -= cross.T @ gone[:, :-1]
        sums.xy[0] -= cross.T @ gone[:, -1]
        sums.yy[0] -= right @ gone[:, -1]
    return sums
