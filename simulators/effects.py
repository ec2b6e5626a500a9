"""Physical effects of the truth by the names of the public contract.

Each value takes the place of the effect's primary parameter in the cell or in its sensors: `hysteresis=0.02` sets the
amplitude to 20 mV, `hysteresis=0` takes it away.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, cast

from simulators.cell_parameters import CellParameters
from simulators.sensors import SensorParameters

__all__ = ["EFFECTS", "Effect", "apply_effects"]


@dataclass(frozen=True, slots=True)
class Effect:
    """Where an effect's primary parameter sits: `part` is "cell" or "sensors", `field` may name a nested one."""

    part: str
    field: str
    unit: str


EFFECTS: MappingProxyType[str, Effect] = MappingProxyType(
    {
        "capacity": Effect("cell", "capacity_Ah", "Ah"),
        "charge_discharge_asymmetry": Effect("cell", "charge_resistance_ratio", "1"),
        "charge_transfer": Effect("cell", "charge_transfer_V", "V"),
        "current_offset": Effect("sensors", "current_offset_A", "A"),
        "entropic_voltage": Effect("cell", "dU_dT_V_per_K", "V/K"),
        "heat_transfer": Effect("cell", "heat_transfer_W_per_K", "W/K"),
        "hysteresis": Effect("cell", "hysteresis_amplitude_V", "V"),
        "relaxation": Effect("cell", "slow.resistance_Ohm", "Ohm"),
        "resistance_growth": Effect("cell", "resistance_growth_per_Ah", "1/Ah"),
        "reversible_heat": Effect("cell", "reversible_heat_V_per_K", "V/K"),
        "self_discharge": Effect("cell", "leakage_A", "A"),
        "series_resistance": Effect("cell", "series_resistance_Ohm", "Ohm"),
        "soc_dependence": Effect("cell", "ohmic_at_empty_Ohm", "Ohm"),
        "temperature_dependence": Effect("cell", "activation_K", "K"),
        "temperature_sensor": Effect("sensors", "temperature_offset_K", "K"),
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
            parts[effect.part] = _with_value(parts[effect.part], effect.field, value)
        except ValueError as error:
            raise ValueError(f"effect {name}={value} {effect.unit}: {error}") from None
    return cast(CellParameters, parts["cell"]), cast(SensorParameters, parts["sensors"])
