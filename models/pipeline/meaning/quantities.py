"""Ranges of the quantities in a model's document, by their names: wide enough for any cell or module on a bench."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

from models.data.errors import StructureError

Range = tuple[float, float]
_SHARE, _COUNT, _SOC = (0.0, 1.0), (0.0, 1e12), (-0.5, 1.5)
# Of whole names, before units count.
_NAMES: Mapping[str, Range] = MappingProxyType(
    {
        "soc": _SOC,
        "dU_dT_soc": _SOC,
        "soc_scale": _SOC,
        "efficiency": (1e-3, 1.0),
        "coulombic_efficiency": (1e-3, 1.0),
        "dt_s": (1e-6, 1e5),
        "k_sigma": (1e-3, 10.0),
        "soc_k_sigma": (1e-3, 10.0),
        "temperature_k_sigma": (1e-3, 10.0),
        "order": (0.0, 1e3),
        "delay": (0.0, 1e4),
        "initial": (1.0, 1e3),
        "direction": (-1.0, 1.0),
        "direction_before": (-1.0, 1.0),
        "samples": _COUNT,
        "effective_samples": _COUNT,
        "n_samples": _COUNT,
        "n_models": _COUNT,
        "n_models_built": _COUNT,
        "n_free": _COUNT,
        "iterations": _COUNT,
        "data_share": (-1e-6, 1.0 + 1e-6),
        "shares": (-1e-6, 1.0 + 1e-6),
        "keep": (-1.0, 1.0),
        "autocorrelation": (-1e9, 1e9),
        "white": (-1.0, 2.0),
        "band_factor": (1e-3, 1e3),
        "bias_mV": (-1e6, 1e6),
        "dU_dT_V_per_K": (-0.1, 0.1),
        "heat_capacity_J_per_K": (1e-6, 1e8),
        "surface_heat_capacity_J_per_K": (1e-6, 1e8),
        "core_to_surface_W_per_K": (0.0, 1e6),
        "heat_transfer_W_per_K": (0.0, 1e6),
        "resistance_K_per_W": (0.0, 1e6),
        "polarisation_Ohm": (-10.0, 10.0),
        "capacity_Ah": (1e-6, 1e6),
        "offset_K": (-100.0, 100.0),
        "squared_error": (0.0, 1e12),
        "noise_V2": (0.0, 1e4),
        "own_V2": (0.0, 1e4),
        "mse_K2": (0.0, 1e6),
        "variances": (0.0, 1e6),
        "granted": (0.0, 1e6),
        "usual": (0.0, 1e6),
    }
)
_UNITS: Mapping[str, Range] = MappingProxyType(
    {
        "mV": (0.0, 1e6),
        "V": (-1e5, 1e5),
        "A": (-1e6, 1e6),
        "s": (0.0, 1e9),
        "Ohm": (-1e3, 1e3),
        "degC": (-150.0, 400.0),
        "Ah": (0.0, 1e6),
        "Hz": (0.0, 1e6),
        "nrmse": (0.0, 1e6),
    }
)
# Standard deviations are positive whatever they are of.
_SPREAD = (0.0, 1e4)
# Parts that a document may name as it likes.
_FREE = ("record.effects", "record.update")


def check_quantities(document: Mapping[str, Any]) -> None:
    """Refuse a quantity that no cell and no measurement can have.

    Raises
    ------
    StructureError
        It names where, the value and the range.
    """
    for where, name, value in _quantities(document, "", ""):
        if where.startswith(_FREE):
            continue
        bounds = _range_of(where, name)
        if bounds is not None and not bounds[0] <= value <= bounds[1]:
            raise StructureError(
                f"model document is damaged: {where[:80]} is {value:g}; it must lie within {bounds[0]:g}..{bounds[1]:g}"
            )


def _range_of(where: str, name: str) -> Range | None:
    if name in _NAMES:
        return _NAMES[name]
    words = name.split("_")
    if "std" in words or where.rpartition(".")[0].endswith((".std", ".granted")):
        return _SPREAD
    return _UNITS.get(words[-1])


def _quantities(value: Any, where: str, name: str) -> Iterator[tuple[str, str, float]]:
    """Every number with its place and the nearest key above it; of a list of them the least and the most."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _quantities(part, f"{where}.{key}" if where else str(key), str(key))
    elif isinstance(value, list) and set(map(type, value)) == {float}:
        yield from ((where, name, min(value)), (where, name, max(value)))
    elif isinstance(value, list):
        for part in value:
            yield from _quantities(part, where, name)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield where, name, float(value)
