"""The request for a profile that would settle what a diagnosis left open."""

from __future__ import annotations

from typing import Any

from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.reference.reference import Reference
from models.effects import effect

_DURATION_S = 4 * 3600.0
# For effects that show over hours only.
_SLOW_DURATION_S = 10 * 3600.0
_REST_RATIO = 8.0
_VOLTAGE_MARGIN_V = 0.02


def discriminating_request(
    reference: Reference | KnownCell, rivals: tuple[str, str], voltage_V: FloatArray, initial_soc: float
) -> dict[str, Any]:
    """Ask for the profile that tells two effects apart, inside the limits that the runs so far kept.

    Parameters
    ----------
    reference : model
    rivals : names of two effects
    voltage_V : measured so far
    initial_soc : where the cell stands at the end of the last run
    """
    domain = reference.domain
    limits = {
        "current_A": list(domain["current_A"]),
        "voltage_V": [float(voltage_V.min()) - _VOLTAGE_MARGIN_V, float(voltage_V.max()) + _VOLTAGE_MARGIN_V],
        "soc": list(domain["soc"]),
    }
    if "temperature_degC" in domain:
        limits["temperature_degC"] = list(domain["temperature_degC"])
    slow = any(effect(name).slow for name in rivals)
    return {
        "capacity_Ah": reference.capacity_Ah,
        "duration_s": _SLOW_DURATION_S if slow else _DURATION_S,
        "dt_s": reference.dt_s,
        "criterion": "discriminate",
        "signal": "optimal",
        "limits": limits,
        "rest_ratio": _REST_RATIO,
        "rivals": list(rivals),
        "soc_levels": 5,
        "initial_soc": initial_soc,
        "seed": 0,
    }
