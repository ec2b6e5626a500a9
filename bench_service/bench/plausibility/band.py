"""What a cell can be: bands that follow from its capacity and the number of cells in series.

The product of resistance and capacity hardly depends on a cell's size: 0.02 to 0.2 Ohm Ah for lithium-ion and Ni-MH at
room temperature (data sheets of 18650 to 100 Ah prismatic cells), ten times that at -20 degC. Heat capacities are 15
to 35 J/K for each Ah. Outside the inner band people are told, outside the outer one the output goes off.
"""

from dataclasses import dataclass

Window = tuple[float, float]

_USUAL_OHM_AH: Window = (0.012, 2.0)
_POSSIBLE_SHARES: Window = (1.0 / 3.0, 4.0)
_HEAT_CAPACITY_J_PER_K_AH: Window = (8.0, 40.0)
# Steepest open-circuit curve that is met between two samples, near empty.
_SLOPE_V_PER_SOC = 30.0
_HIGHEST_CELL_V = 4.3


@dataclass(frozen=True, slots=True)
class CellBand:
    """Bands of one cell, or of cells in series.

    Parameters
    ----------
    capacity_Ah : float
    cells_in_series : int
    usual_Ohm, possible_Ohm : tuple of float
        Resistance, as it shows within two samples of a step.
    heat_capacity_J_per_K : tuple of float
    slope_V_per_As : float
        Steepest change of the voltage at rest by charge.
    top_V : float
        Highest voltage that the limits allow.
    """

    capacity_Ah: float
    cells_in_series: int
    usual_Ohm: Window
    possible_Ohm: Window
    heat_capacity_J_per_K: Window
    slope_V_per_As: float
    top_V: float


def band_of(capacity_Ah: float, voltage_V: Window, resistance_Ohm: Window | None = None) -> CellBand:
    """Return the bands of what has a capacity and may have voltages in a window.

    A resistance that the cell's data sheet tells takes the place of what follows from the capacity.
    """
    cells = max(1, round(voltage_V[1] / _HIGHEST_CELL_V))

    def resistance(window: Window) -> Window:
        return window[0] * cells / capacity_Ah, window[1] * cells / capacity_Ah

    usual = resistance_Ohm or resistance(_USUAL_OHM_AH)
    low, high = _HEAT_CAPACITY_J_PER_K_AH
    return CellBand(
        capacity_Ah=capacity_Ah,
        cells_in_series=cells,
        usual_Ohm=usual,
        possible_Ohm=(usual[0] * _POSSIBLE_SHARES[0], usual[1] * _POSSIBLE_SHARES[1]),
        heat_capacity_J_per_K=(low * cells * capacity_Ah, high * cells * capacity_Ah),
        slope_V_per_As=_SLOPE_V_PER_SOC * cells / (3600.0 * capacity_Ah),
        top_V=voltage_V[1],
    )
