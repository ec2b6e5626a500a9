"""Everything that a diagnosis of a change needs to know of the training runs, without the runs."""

from __future__ import annotations

from dataclasses import dataclass

from models.diagnosis.known.cell import KnownCell
from models.diagnosis.known.elsewhere import Elsewhere
from models.diagnosis.known.lacks import NOTHING_LACKS, Lacks
from models.diagnosis.thermal.heat_balance import HeatBalance
from models.effects.thermal_view import ThermalView
from models.effects.view import View


@dataclass(frozen=True)
class KnownRuns:
    """The training runs as a diagnosis of a change knows them.

    Attributes
    ----------
    cell : bounded network with its covariance
    elsewhere : how far it is off where it was not trained
    balance : of the heat; None where it cannot be known
    lacks : effects that may be missing in the cell
    """

    cell: KnownCell
    elsewhere: Elsewhere
    balance: HeatBalance | None
    lacks: Lacks = NOTHING_LACKS


def simulated_heat(cell: KnownCell, view: View, stride: int, balance: HeatBalance | None = None) -> ThermalView:
    """A run's heat by the simulated, not the measured loss: an unexplained voltage warms nothing.

    Parameters
    ----------
    cell : whose resistances warm
    view : run with every `stride`-th sample
    balance : of the heat; None: to be found
    """
    run, index = view.run, view.index
    loss_V = cell.loss_V(view.inputs, view.soc[index])
    ambient = run.temperature_degC if run.ambient_degC is None else run.ambient_degC
    known = balance or HeatBalance(1.0, 600.0, 0.0, 0.0)
    return ThermalView(
        run.current_A[index] * loss_V,
        run.current_A[index],
        ambient[index],
        run.temperature_degC[index],
        stride * run.dt_s,
        known.resistance_K_per_W,
        known.time_constant_s,
        known.dU_dT_V_per_K,
        known.offset_K,
        known.quick_heat,
        known.quick_chamber,
    )
