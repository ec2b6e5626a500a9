"""What a module adds to the error of its cells' model: their spread, and what is not known of what connects them.

A module is observed as its mean cell. The first order of the cells' differences is not in the mean; the second is: a
mean over different places on the open-circuit curve is off by the curve's bend. It differs from module to module, so
that no run of another module tells it, and it stays with a place on the curve, as the slow error does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.module.models import ModuleModel
from models.network.local_model_network import LocalModelNetwork
from models.observer.filter.settings import ObserverSettings
from models.readouts.ocv import ocv_table
from models.readouts.resistance import resistance_table

# What different capacities make of states of charge that were balanced in the middle, by the time the module is at a
# place like any other: the standard deviation of a number from 0 to 1.
_CHARGE_MOVED = 0.29
# Parallel cells of different resistance share the current unequally until the open-circuit curve pulls them together:
# half of what would come of it without.
_PULLED_TOGETHER = 0.5
# A curve's bend changes along it faster than what a good model of one cell is wrong by.
_BEND_SOC = 0.3
_CURVE_POINTS, _PLACES = 401, 5
_USUAL_DEGC, _MIDDLE_SOC = 25.0, 0.5


@dataclass(frozen=True)
class CellSpread:
    """How different the cells of a module are, as declared for their kind; standard deviations.

    Attributes
    ----------
    soc : of the states of charge, fraction
    capacity, resistance : relative
    connectors : resistance beside the cells where the module model has none (S1), relative to the cells' settled one
    """

    soc: float = 0.01
    capacity: float = 0.02
    resistance: float = 0.05
    connectors: float = 0.15

    def __post_init__(self) -> None:
        """Refuse what is no spread.

        Raises
        ------
        ModelError
            A value is not within 0..1.
        """
        for each in fields(self):
            value = getattr(self, each.name)
            if not 0.0 <= value <= 1.0:
                raise ModelError(f"spread of the cells: {each.name} is {value:g}; a fraction within 0..1 is needed")

    @classmethod
    def declared(cls, values: Mapping[str, float]) -> CellSpread:
        """Spread with some values declared, the usual ones for the rest; a name that is none is a ModelError."""
        names = [each.name for each in fields(cls)]
        unknown = sorted(set(values) - set(names))
        if unknown:
            raise ModelError(f"spread of the cells: {unknown[0]!r} is not known; use {', '.join(names)}")
        return cls(**values)


def module_settings(
    settings: ObserverSettings, network: LocalModelNetwork, module: ModuleModel, spread: CellSpread
) -> ObserverSettings:
    """Widen a cell's settings by what is not known of the module's resistances, and let its slow error change sooner.

    Parameters
    ----------
    settings : tuned for one cell
    network : model of one cell
    module : S1 to S4 with the layout
    spread : of its cells
    """
    cells = module.cells_in_series * module.cells_in_parallel
    of_mean = spread.resistance / np.sqrt(cells) if cells > 1 else 0.0
    if module.kind == "S1":
        series_Ohm = spread.connectors * _settled_Ohm(network)
    else:
        series_Ohm = _rms(module.resistance_std_Ohm) * module.cells_in_parallel / module.cells_in_series
    return replace(
        settings,
        resistance_std=float(np.hypot(settings.resistance_std, of_mean)),
        slow_error_soc=min(settings.slow_error_soc, _BEND_SOC) if cells > 1 else settings.slow_error_soc,
        series_resistance_std_Ohm=float(np.hypot(settings.series_resistance_std_Ohm, series_Ohm)),
    )


def slow_error_V(network: LocalModelNetwork, module: ModuleModel, spread: CellSpread) -> FloatArray:
    """(M,) standard deviation near each local model of what the module adds to the mean cell's slow error.

    The bend of the open-circuit curve over the cells' spread; and the module's offset V_0 itself: nothing in a module
    makes a voltage at rest, so that an identified offset is model error of the runs it was identified from.
    """
    offset_V = np.hypot(_rms(module.offset_V), _rms(module.offset_std_V)) / module.cells_in_series
    return np.hypot(_bend_V(network, module, spread), offset_V)


def _bend_V(network: LocalModelNetwork, module: ModuleModel, spread: CellSpread) -> FloatArray:
    cells = module.cells_in_series * module.cells_in_parallel
    shared = _PULLED_TOGETHER * spread.resistance if module.cells_in_parallel > 1 else 0.0
    width = np.sqrt((1.0 - 1.0 / cells) * (spread.soc**2 + _CHARGE_MOVED**2 * (spread.capacity**2 + shared**2)))
    grid = np.linspace(0.0, 1.0, _CURVE_POINTS)
    curve_V = ocv_table(network, grid, np.array([_USUAL_DEGC])).mean_V[0]
    axis = network.structure.soc_axis
    edges = np.tile([0.0, 1.0], (network.n_models, 1))
    if axis >= 0:
        low, high = network.scaling[network.structure.axes[axis].signal]
        box = network.partition.lower[:, axis], network.partition.upper[:, axis]
        edges = low + (high - low) * np.column_stack(box)
    # Beyond its ends the curve is not known: not its bend either.
    low_end, high_end = np.clip(edges, width, 1.0 - width).T
    places = np.linspace(low_end, high_end, _PLACES, axis=1)
    at, above, below = (np.interp(places + step, grid, curve_V) for step in (0.0, width, -width))
    bend_V = np.sqrt(np.mean((0.5 * (above + below) - at) ** 2, axis=1))
    # Where the mean cell's curve is straight, that of cells apart need not be: no less than what is usual on the curve.
    return np.maximum(bend_V, np.median(bend_V))


def _settled_Ohm(network: LocalModelNetwork) -> float:
    """Resistance of one cell in the middle of everything, discharged at 1C."""
    current_A = -network.cell.capacity_Ah
    return float(abs(resistance_table(network, _MIDDLE_SOC, current_A, _USUAL_DEGC).resistance_Ohm[0, 0, 0]))


def _rms(pair: tuple[float, float]) -> float:
    return float(np.sqrt(np.mean(np.square(pair))))
