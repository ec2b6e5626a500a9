"""Puts values in place of names in a document."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.program import Window

# So far from the bench's limits of voltage that neither noise nor the last sample of a steep end breaks them.
_TOP_MARGIN_V = 0.02
_BOTTOM_SHARE = 0.12


def bench_values(window: Window, capacity_Ah: float) -> dict[str, float]:
    """Return what a bench offers to defaults, by name.

    ``voltage_high`` and ``voltage_low`` lie inside the limits; ``charge_C`` and ``discharge_C`` are 1C, or what the
    limits allow where that is less; ``slow_C`` is C/20.
    """
    low_V, high_V = window.voltage_V
    low_A, high_A = window.current_A
    digits = 4
    return {
        "voltage_high": round(high_V - max(_TOP_MARGIN_V, 0.004 * high_V), digits),
        "voltage_low": round(low_V + _BOTTOM_SHARE * (high_V - low_V), digits),
        "charge_C": min(1.0, round(high_A / capacity_Ah, digits)),
        "discharge_C": min(1.0, round(-low_A / capacity_Ah, digits)),
        "pulse_C": min(1.0, round(min(high_A, -low_A) / capacity_Ah, digits)),
        "capacity_Ah": capacity_Ah,
    }


def fill(node: Any, values: Mapping[str, Any]) -> Any:
    """Return a document in which every name stands for its value.

    Raises
    ------
    ProtocolError
        A name is not known.
    """
    if isinstance(node, str):
        return _value(node, values)
    if isinstance(node, Mapping):
        return {key: fill(value, values) for key, value in node.items()}
    if isinstance(node, list):
        return [made for each in node for made in _written_out(each, values)]
    return node


def _written_out(node: Any, values: Mapping[str, Any]) -> list[Any]:
    if not (isinstance(node, Mapping) and node.get("step") == "each"):
        return [fill(node, values)]
    rounds = _value(node["of"], values)
    return [made for value in rounds for made in fill(node["steps"], {**values, node["as"]: value})]


def _value(text: str, values: Mapping[str, Any]) -> Any:
    negative, name = text.startswith("-$"), text.lstrip("-")
    if not name.startswith("$"):
        return text
    if name[1:] not in values:
        raise ProtocolError("nothing stands behind this name", (), value=text)
    value = values[name[1:]]
    return -value if negative else value
