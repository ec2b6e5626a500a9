"""Constants of one simulated cell, checked once."""

import math
from dataclasses import dataclass, fields

from simulators.chemistry import OpenCircuitCurve

__all__ = ["Branch", "CellParameters"]


@dataclass(frozen=True, slots=True)
class Branch:
    """One first-order overpotential: resistance in ohm at 25 degC and time constant in second."""

    resistance_Ohm: float
    time_constant_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CellParameters:
    """Constants of one cell, resistances at 25 degC.

    Attributes
    ----------
    open_circuit : OpenCircuitCurve
        Voltage over state of charge at 25 degC.
    capacity_Ah : float
    ohmic_Ohm : float
        Instantaneous resistance at a high state of charge.
    ohmic_at_empty_Ohm : float
        Added at `soc` 0; falls by 1/e for each 0.15 of charge.
    fast_1, fast_2, slow : Branch
        Two fast pairs (1..3 s, 20..40 s) and slow diffusion (600..1500 s).
    hysteresis_amplitude_V, hysteresis_rate : float
        Half the width of the major loop; rate per capacity (h is within 1/e after Q / rate of charge).
    charge_transfer_V, exchange_current_A : float
        Butler-Volmer with symmetric transfer, overpotential A asinh(i / (2 i0)); A is 2 R T / F = 51 mV for one
        electrode. A is taken as constant: its proportionality to T is far weaker than the Arrhenius factor.
    activation_K : float
        Activation energy over the gas constant; resistance grows as exp(B (1/T - 1/298 K)).
    charge_resistance_ratio : float
        Resistance on charge over that on discharge.
    resistance_growth_per_Ah : float
        Relative growth of all resistances for each ampere-hour through the cell, either way.
    series_resistance_Ohm : float
        Contact outside the cell: in the voltage, not in the cell's heat.
    contact_Ohm : float
        Contact outside the cell that comes and goes: there for some minutes at a time, a third of the time.
    core_K_per_W : float
        By how much more the core, whose temperature the resistances follow, is warmer than the cell for each watt.
    leakage_A : float
        Internal current that discharges the cell; its power heats the cell.
    dU_dT_V_per_K : float
        Slope of the open-circuit voltage over temperature; moves the voltage and makes reversible heat.
    reversible_heat_V_per_K : float
        Further reversible heat that leaves the voltage alone.
    heat_capacity_J_per_K, heat_transfer_W_per_K : float
        Lumped thermal model against the ambient temperature.
    """

    open_circuit: OpenCircuitCurve
    capacity_Ah: float
    ohmic_Ohm: float
    ohmic_at_empty_Ohm: float
    fast_1: Branch
    fast_2: Branch
    slow: Branch
    hysteresis_amplitude_V: float
    hysteresis_rate: float
    charge_transfer_V: float
    exchange_current_A: float
    activation_K: float
    heat_capacity_J_per_K: float
    heat_transfer_W_per_K: float
    charge_resistance_ratio: float = 1.0
    resistance_growth_per_Ah: float = 0.0
    series_resistance_Ohm: float = 0.0
    contact_Ohm: float = 0.0
    core_K_per_W: float = 0.0
    leakage_A: float = 0.0
    dU_dT_V_per_K: float = 0.0
    reversible_heat_V_per_K: float = 0.0

    def __post_init__(self) -> None:
        """Check the parameters once.

        Raises
        ------
        ValueError
            If one is not finite, or a capacity, time constant or heat capacity is not positive.
        """
        branches = (self.fast_1, self.fast_2, self.slow)
        numbers = {f.name: getattr(self, f.name) for f in fields(self)}
        values = {name: value for name, value in numbers.items() if isinstance(value, int | float)}
        for index, branch in enumerate(branches):
            values[f"branch {index} resistance_Ohm"] = branch.resistance_Ohm
            values[f"branch {index} time_constant_s"] = branch.time_constant_s
        for name, value in values.items():
            if not math.isfinite(value):
                raise ValueError(f"cell parameter {name} is {value}; a finite number is needed")
        positive = ("capacity_Ah", "exchange_current_A", "heat_capacity_J_per_K", "charge_resistance_ratio")
        for name in (*positive, *(key for key in values if key.endswith("time_constant_s"))):
            if values[name] <= 0:
                raise ValueError(f"cell parameter {name} is {values[name]}; it must be above 0")
