"""As much of JSON Schema as the service's own document uses: types, properties, items, alternatives, references."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

_TYPES: dict[str, Any] = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "integer": int,
    "number": (int, float),
    "null": type(None),
}


def faults(value: Any, schema: dict[str, Any], components: dict[str, Any], where: str = "") -> Iterator[str]:
    """Say where a value is not what its schema says."""
    if "$ref" in schema:
        yield from faults(value, components[schema["$ref"].rsplit("/", 1)[1]], components, where)
        return
    if "anyOf" in schema:
        if all(list(faults(value, each, components, where)) for each in schema["anyOf"]):
            yield f"{where}: {value!r} is none of {len(schema['anyOf'])} alternatives"
        return
    if "enum" in schema and value not in schema["enum"]:
        yield f"{where}: {value!r} is none of {schema['enum']}"
    kind = schema.get("type")
    if kind is not None and (not isinstance(value, _TYPES[kind]) or (isinstance(value, bool) and kind != "boolean")):
        yield f"{where}: {type(value).__name__} where {kind} was said"
        return
    if isinstance(value, dict):
        yield from (f"{where}.{key} is missing" for key in schema.get("required", ()) if key not in value)
        for key, each in schema.get("properties", {}).items():
            if key in value:
                yield from faults(value[key], each, components, f"{where}.{key}")
    if isinstance(value, list):
        items = schema.get("prefixItems") or [schema.get("items", {})] * len(value)
        for k, (each, item) in enumerate(zip(value, items, strict=True)):
            yield from faults(each, item, components, f"{where}[{k}]")
