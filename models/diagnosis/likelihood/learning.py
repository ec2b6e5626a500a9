"""From training runs to everything that a diagnosis of a change needs to know of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.known.elsewhere import UNLEARNED, Points, learn, points_of
from models.diagnosis.known.fitting import fit_known
from models.diagnosis.known.lacks import lacks_of
from models.diagnosis.known.left import Left
from models.diagnosis.known.memory import KnownRuns, simulated_heat
from models.diagnosis.likelihood.granted import ALL_RESISTANCES, all_resistances, learned_columns
from models.diagnosis.likelihood.shapes import shapes_of
from models.diagnosis.likelihood.sight import RunSight, Sight
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.diagnosis.thermal.heat_balance import HeatBalance, fit_views, has_temperature
from models.effects import Effect
from models.effects.view import View
from models.identification.bounded.variants import Variant


def know(
    runs: list[GridRun],
    soc: list[float],
    capacity_Ah: float,
    effects: list[Effect],
    variant: Variant | None = None,
    *,
    starts_known: bool = False,
) -> KnownRuns:
    """Take from the training runs what a diagnosis needs.

    Parameters
    ----------
    runs, soc : on one grid, with their SoC at the start
    capacity_Ah : of the cell
    effects : that may be asked for
    variant : form of the bounded network; None: chosen by held-out error
    starts_known : the runs were simulated, at rest, from just where they are said to begin
    """
    cell, left = fit_known(runs, soc, capacity_Ah, variant, starts_known=starts_known)
    views = [View(cell, run, s, left.index[left.run == r]) for r, (run, s) in enumerate(zip(runs, soc, strict=True))]
    points = Points.joined([points_of(view, number, cell.domain) for number, view in enumerate(views)])
    nobody = np.zeros(0, dtype=np.int64)
    runs_seen = tuple(RunSight(view, view, np.arange(len(view.index)), None, nobody) for view in views)
    sight = Sight(KnownRuns(cell, UNLEARNED, None), runs_seen, 1.0)
    learned = [one for one in effects if one.expected.learned]
    own = learned_columns(sight, {one.name: shapes_of(sight, one) for one in learned})
    elsewhere = learn(points, left.fitted_V, left.unseen_V, left.open_V2, _from_run_to_run(sight, left, own))
    # How charge is counted is not of the cell: open there, it would hide what moves the state of charge.
    of_cell = {each.name for each in effects if each.shift is None or each.shift.soc is None}
    lacks = lacks_of(left, cell.layout.size, {name: columns for name, columns in own.items() if name in of_cell})
    return KnownRuns(cell, elsewhere, _balance(cell, views), lacks)


def _from_run_to_run(sight: Sight, left: Left, own: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """By effect, (m, m) V^2 that one of usual size makes, another one in each run: no two runs of a cell are alike."""
    same = left.run[:, None] == left.run[None, :]
    every = own | {ALL_RESISTANCES: all_resistances(sight)}
    return {name: np.where(same, columns @ columns.T, 0.0) for name, columns in every.items()}


def _balance(cell: KnownCell, views: list[View]) -> HeatBalance | None:
    if not all(has_temperature(view.run) for view in views):
        return None
    stride = max(1, -(-sum(len(view.run) for view in views) // THRESHOLDS.simulated))
    every = [replace(view, index=np.arange(0, len(view.run), stride)) for view in views]
    return fit_views([simulated_heat(cell, view, stride) for view in every])
