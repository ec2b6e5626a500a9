"""The schema of what each operation answers with, out of what its route says (`answers`): records, and named keys."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any, get_type_hints

from pydantic import TypeAdapter

from bench_service.api.answers import ANSWER, ASKED, SHOWN
from bench_service.api.record_examples import record_examples
from bench_service.jobs.modelling import plain
from bench_service.jobs.runner import Job
from bench_service.store.cells import CellRecord
from bench_service.store.diagnoses import DiagnosisRecord
from bench_service.store.records import (
    CampaignRecord,
    ComparisonRecord,
    EventRecord,
    ModelRecord,
    ProfileRecord,
    ProtocolRecord,
    RunRecord,
)

Schema = dict[str, Any]

_RECORDS: dict[str, type] = {
    "Run": RunRecord,
    "Model": ModelRecord,
    "Comparison": ComparisonRecord,
    "Diagnosis": DiagnosisRecord,
    "Campaign": CampaignRecord,
    "Event": EventRecord,
    "Profile": ProfileRecord,
    "Protocol": ProtocolRecord,
    "Cell": CellRecord,
    "Job": Job,
}
_HIDDEN = {"Campaign": {"done"}}  # fields that stay inside
_OPAQUE = {"stages"}  # typed dicts, which pydantic does not take from Python 3.11
_METHODS = ("get", "post", "put", "patch", "delete")
_JSON = "application/json"


def described(document: Schema) -> Schema:
    """Put what every operation answers with into the OpenAPI document of the application; once."""
    components = document.setdefault("components", {}).setdefault("schemas", {})
    if "Error" in components:
        return document
    examples = plain(record_examples())
    components |= {name: record_schema(name) | {"examples": [_shown(name, examples[name])]} for name in _RECORDS} | {
        "Error": _error(),
        "Problem": _problem(),
    }
    for unused in ("HTTPValidationError", "ValidationError"):
        components.pop(unused, None)
    for address, methods in document["paths"].items():
        for method in _METHODS:
            if method in methods:
                _describe(f"{method.upper()} {address}", methods[method])
    return document


def _shown(name: str, example: Schema) -> Schema:
    return {field: value for field, value in example.items() if field not in _HIDDEN.get(name, ())}


def answer_schema(said: Schema) -> Schema:
    """Return the schema of the JSON that an operation answers with, of what its route says."""
    if "list" in said:
        items = _reference(said["record"]) if "record" in said else {"type": "object"}
        cursor = {"next_cursor": {"anyOf": [{"type": "integer"}, {"type": "null"}]}} if "paged" in said else {}
        return _object({said["list"]: {"type": "array", "items": items}} | cursor)
    return _reference(said["record"]) if "record" in said else _object({key: {} for key in said["keys"]})


def record_schema(name: str) -> Schema:
    """Return the schema of a record; every field is required, as each answer has them all."""
    kind, hidden = _RECORDS[name], _HIDDEN.get(name, set())
    hints = get_type_hints(kind)
    known = [each.name for each in fields(kind) if each.name not in hidden]
    properties = {
        field: {"type": "array", "items": {"type": "object"}} if field in _OPAQUE else _plain(hints[field])
        for field in known
    }
    text = (kind.__doc__ or "").split("\n\n")[0].strip()
    return {"title": name, "description": text, **_object(properties)}


def _plain(hint: Any) -> Schema:
    schema = TypeAdapter(hint).json_schema()
    definitions = schema.pop("$defs", {})
    return _inlined(schema, definitions)


def _inlined(schema: Any, definitions: Schema) -> Any:
    """Put what pydantic refers to in its own definitions where it is used: OpenAPI keeps them elsewhere."""
    if isinstance(schema, list):
        return [_inlined(each, definitions) for each in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        return _inlined(definitions[schema["$ref"].rsplit("/", 1)[1]], definitions)
    return {key: _inlined(value, definitions) for key, value in schema.items() if key != "title"}


def _describe(name: str, operation: Schema) -> None:
    said, responses = operation.pop(ANSWER, None), operation["responses"]
    if said is None:
        raise LookupError(
            f"{name} does not say what it answers with: its route needs openapi_extra, see api/answers.py"
        )
    done = next(code for code in responses if code.startswith("2"))
    if "files" in said:
        responses[done]["content"] = {kind: {} for kind in said["files"]}
    else:
        responses[done]["content"] = {_JSON: {"schema": answer_schema(said)}}
    if (example := operation.pop(ASKED, None)) is not None:
        operation["requestBody"]["content"][_JSON]["example"] = json.loads(example)
    if (example := operation.pop(SHOWN, None)) is not None:
        responses[done]["content"][_JSON]["example"] = json.loads(example)
    responses.pop("422", None)
    told = {_JSON: {"schema": _reference("Error")}, "application/problem+json": {"schema": _reference("Problem")}}
    responses["default"] = {"description": "What is wrong, and where", "content": told}


def _reference(name: str) -> Schema:
    return {"$ref": f"#/components/schemas/{name}"}


def _object(properties: Schema) -> Schema:
    return {"type": "object", "properties": properties, "required": [*properties]}


def _error() -> Schema:
    where = {"anyOf": [{"type": "array", "items": {}}, {"type": "null"}]}
    told = _object({"code": {"type": "string"}, "message": {"type": "string"}, "where": where})
    return {"title": "Error", **_object({"error": told})}


def _problem() -> Schema:
    texts = {key: {"type": "string"} for key in ("type", "title", "detail", "code")}
    return {"title": "Problem", **_object(texts | {"status": {"type": "integer"}, "where": {}})}
