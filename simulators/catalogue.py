"""The default simulated cells and their limits.

Sizes and limits follow public data sheets of cells of the kind (named per cell); resistances and time constants are
round numbers of the size that pulse tests of such cells show (Plett, Battery Management Systems I, 2015, chapter 2).
Hysteresis of Ni-MH after Srinivasan, Weidner and White, J. Electrochem. Soc. 148, 2001; of LFP after Dreyer et al.,
Nature Materials 9, 2010. The coulombic efficiency of all three is 1.
"""

from dataclasses import dataclass
from types import MappingProxyType

from simulators.cell_parameters import Branch, CellParameters
from simulators.chemistry import OPEN_CIRCUIT_CURVES

__all__ = ["CELLS", "CellLimits", "CellType", "cell_type"]


@dataclass(frozen=True, slots=True)
class CellLimits:
    """What the cell's data sheet allows, each as (low, high)."""

    voltage_V: tuple[float, float]
    current_A: tuple[float, float]
    temperature_degC: tuple[float, float]


@dataclass(frozen=True, slots=True)
class CellType:
    """A cell that can be ordered by name."""

    name: str
    title: str
    parameters: CellParameters
    limits: CellLimits


_NMC = CellType(
    "nmc",
    "NMC 18650 power cell, 2.5 Ah",  # limits as Samsung INR18650-25R, current held to 4C
    CellParameters(
        open_circuit=OPEN_CIRCUIT_CURVES["nmc"],
        capacity_Ah=2.5,
        ohmic_Ohm=0.020,
        ohmic_at_empty_Ohm=0.006,
        fast_1=Branch(0.006, 1.5),
        fast_2=Branch(0.008, 25.0),
        slow=Branch(0.012, 900.0),
        hysteresis_amplitude_V=0.004,
        hysteresis_rate=40.0,
        charge_transfer_V=0.0514,
        exchange_current_A=5.0,
        activation_K=2500.0,
        dU_dT_V_per_K=-1e-4,
        heat_capacity_J_per_K=45.0,
        heat_transfer_W_per_K=0.10,
    ),
    CellLimits((2.5, 4.2), (-10.0, 5.0), (-20.0, 60.0)),
)
_LFP = CellType(
    "lfp",
    "LFP 26650 power cell, 2.5 Ah",  # limits as A123 ANR26650M1B, discharge held to 10C
    CellParameters(
        open_circuit=OPEN_CIRCUIT_CURVES["lfp"],
        capacity_Ah=2.5,
        ohmic_Ohm=0.007,
        ohmic_at_empty_Ohm=0.002,
        fast_1=Branch(0.003, 1.2),
        fast_2=Branch(0.004, 30.0),
        slow=Branch(0.006, 1200.0),
        hysteresis_amplitude_V=0.012,
        hysteresis_rate=30.0,
        charge_transfer_V=0.0514,
        exchange_current_A=10.0,
        activation_K=3000.0,
        dU_dT_V_per_K=5e-5,
        heat_capacity_J_per_K=76.0,
        heat_transfer_W_per_K=0.15,
    ),
    CellLimits((2.0, 3.65), (-25.0, 10.0), (-20.0, 60.0)),
)
_NIMH = CellType(
    "nimh",
    "Ni-MH AA cell, 2.0 Ah",  # limits as Panasonic BK-3MCCE
    CellParameters(
        open_circuit=OPEN_CIRCUIT_CURVES["nimh"],
        capacity_Ah=2.0,
        ohmic_Ohm=0.018,
        ohmic_at_empty_Ohm=0.005,
        fast_1=Branch(0.005, 2.5),
        fast_2=Branch(0.007, 40.0),
        slow=Branch(0.012, 1500.0),
        hysteresis_amplitude_V=0.025,
        hysteresis_rate=12.0,
        charge_transfer_V=0.0514,
        exchange_current_A=6.0,
        activation_K=2000.0,
        dU_dT_V_per_K=-3e-4,
        heat_capacity_J_per_K=26.0,
        heat_transfer_W_per_K=0.07,
    ),
    CellLimits((0.9, 1.6), (-6.0, 2.0), (-10.0, 50.0)),
)

CELLS: MappingProxyType[str, CellType] = MappingProxyType({cell.name: cell for cell in (_NMC, _LFP, _NIMH)})


def cell_type(name: str) -> CellType:
    """Return a default cell by name.

    Raises
    ------
    ValueError
        If there is no such cell; the message lists the names.
    """
    try:
        return CELLS[name]
    except KeyError:
        raise ValueError(f"unknown cell {name!r}; choose one of {', '.join(CELLS)}") from None
