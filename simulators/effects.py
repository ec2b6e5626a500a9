"""Physical effects of the truth by the names of the public contract.

Each value takes the place of the effect's primary parameter in the cell or in its sensors: `hysteresis=0.02` sets the
amplitude to 20 mV, `hysteresis=0` takes it away. Electrodes age from the cell as it is: capacity and open-circuit curve
change together.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, cast

from simulators.cell_parameters import CellParameters
from simulators.sensors import SensorParameters

__all__ = ["EFFECTS", "Effect", "apply_effects"]


@dataclass(frozen=True, slots=True)
class Effect:
    """Where an effect's primary parameter sits: `part` is "cell" or "sensors", `field` may name a nested one.

    An effect without a field is a change of the whole cell, `aged`.
    """

    part: str
    field: str
    unit: str
    aged: Callable[[CellParameters, float], CellParameters] | None = None


def _without_lithium(cell: CellParameters, share: float) -> CellParameters:
    curve = cell.open_circuit.aged(lithium_lost=_lost(share))
    return replace(cell, capacity_Ah=cell.capacity_Ah * (1.0 - share), open_circuit=curve)


def _without_negative(cell: CellParameters, share: float) -> CellParameters:
    """Half full of lithium, which is gone with it."""
    lithium = 0.5 * _lost(share)
    curve = cell.open_circuit.aged(lithium_lost=lithium, negative_lost=share)
    return replace(cell, capacity_Ah=cell.capacity_Ah * (1.0 - lithium), open_circuit=curve)


def _lost(share: float) -> float:
    if not 0.0 <= share < 1.0:
        raise ValueError("a share of 0 or more, below 1, can be lost")
    return share


EFFECTS: MappingProxyType[str, Effect] = MappingProxyType(
    {
        "active_material_loss": Effect("cell", "", "1", _without_negative),
        "capacity": Effect("cell", "capacity_Ah", "Ah"),
        "charge_discharge_asymmetry": Effect("cell", "charge_resistance_ratio", "1"),
        "charge_transfer": Effect("cell", "charge_transfer_V", "V"),
        "core_temperature": Effect("cell", "core_K_per_W", "K/W"),
        "current_gain": Effect("sensors", "current_gain", "1"),
        "current_offset": Effect("sensors", "current_offset_A", "A"),
        "entropic_voltage": Effect("cell", "dU_dT_V_per_K", "V/K"),
        # No effect by itself: the current at which charge transfer begins to bend.
        "exchange_current": Effect("cell", "exchange_current_A", "A"),
        "heat_transfer": Effect("cell", "heat_transfer_W_per_K", "W/K"),
        "hysteresis": Effect("cell", "hysteresis_amplitude_V", "V"),
        "intermittent_contact": Effect("cell", "contact_Ohm", "Ohm"),
        "lithium_loss": Effect("cell", "", "1", _without_lithium),
        "relaxation": Effect("cell", "slow.resistance_Ohm", "Ohm"),
        "resistance_growth": Effect("cell", "resistance_growth_per_Ah", "1/Ah"),
        "reversible_heat": Effect("cell", "reversible_heat_V_per_K", "V/K"),
        "self_discharge": Effect("cell", "leakage_A", "A"),
        "series_resistance": Effect("cell", "series_resistance_Ohm", "Ohm"),
        "soc_dependence": Effect("cell", "ohmic_at_empty_Ohm", "Ohm"),
        "temperature_dependence": Effect("cell", "activation_K", "K"),
        "temperature_sensor": Effect("sensors", "temperature_offset_K", "K"),
        "voltage_gain": Effect("sensors", "voltage_gain", "1"),
        "voltage_offset": Effect("sensors", "voltage_offset_V", "V"),
    }
)


def _with_value(target: Any, field: str, value: float) -> Any:
    head, _, rest = field.partition(".")
    return replace(target, **{head: _with_value(getattr(target, head), rest, value) if rest else value})


def apply_effects(
    cell: CellParameters, sensors: SensorParameters, effects: Mapping[str, float]
) -> tuple[CellParameters, SensorParameters]:
    """Return the parameters with the effects set to their values.

    Parameters
    ----------
    cell : CellParameters
    sensors : SensorParameters
    effects : Mapping[str, float]
        Value of the primary parameter by the effect's name, in the SI unit of `EFFECTS`.

    Raises
    ------
    ValueError
        If a name is unknown (the message lists the names) or a value is not finite or physically impossible.
    """
    parts: dict[str, Any] = {"cell": cell, "sensors": sensors}
    for name, value in effects.items():
        effect = EFFECTS.get(name)
        if effect is None:
            raise ValueError(f"unknown effect {name!r}; the simulated cell knows {', '.join(sorted(EFFECTS))}")
        try:
            part = parts[effect.part]
            parts[effect.part] = effect.aged(part, value) if effect.aged else _with_value(part, effect.field, value)
        except ValueError as error:
            raise ValueError(f"effect {name}={value} {effect.unit}: {error}") from None
    return cast(CellParameters, parts["cell"]), cast(SensorParameters, parts["sensors"])
