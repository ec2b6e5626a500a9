"""How a simulated module is built, and the draw of its unequal cells."""

import math
from dataclasses import dataclass, replace

import numpy as np

from simulators.cell_parameters import Branch, CellParameters

__all__ = ["ModuleLayout", "spread_cells"]

LEAST_SOC, MOST_SOC = 0.0, 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleLayout:
    """How a module is built and how unequal its cells are.

    Attributes
    ----------
    cells_in_series, cells_in_parallel : int
    connector_resistance_Ohm : float
        From one parallel group to the next, terminals included: a module has as many as groups.
    capacity_spread, resistance_spread : float
        Relative standard deviation over the module's cells.
    soc_spread : float
        Standard deviation of the state of charge at the start.
    seed : int
        Of all draws.
    """

    cells_in_series: int = 1
    cells_in_parallel: int = 1
    connector_resistance_Ohm: float = 0.0
    capacity_spread: float = 0.0
    resistance_spread: float = 0.0
    soc_spread: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the layout once.

        Raises
        ------
        ValueError
            If there is no cell, or a resistance or a spread is negative, not finite or 25 % and more.
        """
        if self.cells_in_series < 1 or self.cells_in_parallel < 1:
            raise ValueError(f"module of {self.cells_in_series} x {self.cells_in_parallel} cells; at least 1 x 1")
        if not 0.0 <= self.connector_resistance_Ohm < math.inf:
            raise ValueError(f"connector_resistance_Ohm is {self.connector_resistance_Ohm}; it must be 0 or above")
        for name in ("capacity_spread", "resistance_spread", "soc_spread"):
            if not 0.0 <= getattr(self, name) < 0.25:
                raise ValueError(f"{name} is {getattr(self, name)}; it must lie in 0..0.25")

    @property
    def connectors_Ohm(self) -> float:
        """Resistance of all connectors together: what the module has beyond its cells."""
        return self.cells_in_series * self.connector_resistance_Ohm


def spread_cells(
    parameters: CellParameters, soc: float, layout: ModuleLayout
) -> tuple[list[list[CellParameters]], list[list[float]]]:
    """Draw the cells of a module.

    The mean over the module is that of the cell type: a module of cells that are all weaker than the one on the cell
    bench is another matter than spread.

    Parameters
    ----------
    parameters : CellParameters
        The cell type.
    soc : float
        Mean state of charge at the start.
    layout : ModuleLayout

    Returns
    -------
    parameters and states of charge, one list per parallel group
    """
    rng = np.random.default_rng(layout.seed)
    shape = (layout.cells_in_series, layout.cells_in_parallel)
    capacity, resistance, offset = (_centred(rng, shape) for _ in range(3))
    cells, socs = [], []
    for s in range(shape[0]):
        cells.append(
            [
                _scaled(
                    parameters,
                    float(1.0 + layout.capacity_spread * capacity[s, p]),
                    float(1.0 + layout.resistance_spread * resistance[s, p]),
                )
                for p in range(shape[1])
            ]
        )
        starts = np.clip(soc + layout.soc_spread * offset[s], LEAST_SOC, MOST_SOC)
        socs.append([float(value) for value in starts])
    return cells, socs


def _centred(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Draw numbers of mean 0 and standard deviation 1 (0 for a single cell), without far outliers."""
    draws = np.clip(rng.standard_normal(shape), -2.5, 2.5)
    draws -= draws.mean()
    size = float(draws.std())
    return draws / size if size > 0.0 else draws


def _scaled(p: CellParameters, capacity: float, resistance: float) -> CellParameters:
    branches = {
        name: Branch(branch.resistance_Ohm * resistance, branch.time_constant_s)
        for name, branch in (("fast_1", p.fast_1), ("fast_2", p.fast_2), ("slow", p.slow))
    }
    return replace(
        p,
        capacity_Ah=p.capacity_Ah * capacity,
        ohmic_Ohm=p.ohmic_Ohm * resistance,
        ohmic_at_empty_Ohm=p.ohmic_at_empty_Ohm * resistance,
        exchange_current_A=p.exchange_current_A / resistance,
        **branches,
    )
