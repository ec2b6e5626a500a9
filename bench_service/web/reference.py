"""The REST interface as a page: every operation with what it takes, what it answers and an example of both."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

_KEPT = ("enum", "minimum", "maximum", "maxLength", "default")
_WORDS = {"minimum": "from", "maximum": "to", "maxLength": "at most, in characters,", "default": "without it"}


@dataclass(frozen=True)
class Parameter:
    """A part of the address or a field of the body; `kind`: what may stand there, in words."""

    name: str
    place: str
    required: bool
    kind: str


@dataclass(frozen=True)
class Content:
    """A body of one media type; `example` is JSON, or empty where there is none."""

    media_type: str
    example: str


@dataclass(frozen=True)
class Operation:
    """One method of one address; `anchor` is its place on the page."""

    method: str
    path: str
    anchor: str
    text: str
    parameters: list[Parameter]
    takes: list[Content]
    answers: list[tuple[str, list[Content]]]


def reference(document: Mapping[str, Any]) -> dict[str, list[Operation]]:
    """Return the operations of an OpenAPI document by their tags, in its order."""
    schemas: Mapping[str, Any] = document.get("components", {}).get("schemas", {})
    found: dict[str, list[Operation]] = {}
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            made = _operation(method.upper(), path, operation, schemas)
            found.setdefault(operation.get("tags", ["service"])[0], []).append(made)
    return found


def example_of(schema: Mapping[str, Any], schemas: Mapping[str, Any]) -> Any:
    """An example of a schema, put together from those of its parts; None where nothing says one."""
    if "$ref" in schema:
        return example_of(schemas[schema["$ref"].rpartition("/")[2]], schemas)
    if "example" in schema:
        return schema["example"]
    if schema.get("examples"):
        return schema["examples"][0]
    if schema.get("type") == "array":
        item = example_of(schema.get("items", {}), schemas)
        return None if item is None else [item]
    parts = {name: example_of(part, schemas) for name, part in schema.get("properties", {}).items()}
    return {name: part for name, part in parts.items() if part is not None} or None


def _operation(method: str, path: str, operation: Mapping[str, Any], schemas: Mapping[str, Any]) -> Operation:
    return Operation(
        method=method,
        path=path,
        anchor=operation["operationId"],
        text=operation.get("description", operation.get("summary", "")).replace("``", ""),
        parameters=[
            Parameter(each["name"], each["in"], each.get("required", False), _kind(each["schema"]))
            for each in operation.get("parameters", [])
        ]
        + list(_fields(operation.get("requestBody", {}), schemas)),
        takes=list(_contents(operation.get("requestBody", {}), schemas)),
        # Errors have one form everywhere; the page shows it once.
        answers=[
            (status, list(_contents(answer, schemas)))
            for status, answer in operation["responses"].items()
            if status != "default"
        ],
    )


def _fields(body: Mapping[str, Any], schemas: Mapping[str, Any]) -> Iterator[Parameter]:
    """The fields of a JSON body at its first level."""
    schema: Mapping[str, Any] = body.get("content", {}).get("application/json", {}).get("schema", {})
    if "$ref" in schema:
        schema = schemas[schema["$ref"].rpartition("/")[2]]
    for name, part in schema.get("properties", {}).items():
        yield Parameter(name, "body", name in schema.get("required", ()), _kind(part))


def _contents(body: Mapping[str, Any], schemas: Mapping[str, Any]) -> Iterator[Content]:
    for media_type, content in body.get("content", {}).items():
        example = content.get("example") or example_of(content.get("schema", {}), schemas)
        yield Content(media_type, "" if example is None else json.dumps(example, indent=2, ensure_ascii=False))


def _kind(schema: Mapping[str, Any]) -> str:
    """What may stand in a parameter, such as "integer, from 1, to 1000, without it 100"."""
    choices = [each for each in schema.get("anyOf", [schema]) if each.get("type") != "null"]
    words = []
    for each in choices:
        parts = [each.get("type", "object")]
        for name in _KEPT:
            value = {**schema, **each}.get(name)
            if value is not None:
                told = " | ".join(map(str, value)) if name == "enum" else f"{_WORDS[name]} {value}"
                parts.append(told)
        words.append(", ".join(parts))
    return " or ".join(words)
