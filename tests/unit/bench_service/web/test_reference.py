"""What the page of the REST interface says of an operation."""

from __future__ import annotations

import json
from pathlib import Path

from bench_service.app.application import create_app
from bench_service.config import ServiceConfig
from bench_service.web.reference import Parameter, example_of, reference

_DOCUMENT = {
    "paths": {
        "/things/{name}": {
            "post": {
                "tags": ["things"],
                "operationId": "make",
                "description": "Make one.\n\nOr ``two``.",
                "parameters": [
                    {"name": "name", "in": "path", "required": True, "schema": {"type": "string"}},
                    {"name": "n", "in": "query",
                     "schema": {"anyOf": [{"type": "integer", "minimum": 1}, {"type": "null"}], "default": 3}},
                ],
                "requestBody": {"content": {"application/json": {"schema": {"$ref": "#/components/schemas/Body"}}}},
                "responses": {"201": {"content": {"text/csv": {}}}, "default": {}},
            }
        }
    },
    "components": {
        "schemas": {
            "Body": {"type": "object", "required": ["kind"],
                     "properties": {"kind": {"type": "string", "enum": ["a", "b"], "example": "a"},
                                    "parts": {"type": "array", "items": {"$ref": "#/components/schemas/Part"}}}},
            "Part": {"examples": [{"size_V": 1.0}]},
        }
    },
}  # fmt: skip


def test_an_operation_says_what_it_takes_and_answers() -> None:
    (made,) = reference(_DOCUMENT)["things"]
    assert (made.method, made.path, made.text) == ("POST", "/things/{name}", "Make one.\n\nOr two.")
    assert made.parameters == [
        Parameter("name", "path", True, "string"),
        Parameter("n", "query", False, "integer, from 1, without it 3"),
        Parameter("kind", "body", True, "string, a | b"),
        Parameter("parts", "body", False, "array"),
    ]
    (taken,) = made.takes
    assert json.loads(taken.example) == {"kind": "a", "parts": [{"size_V": 1.0}]}
    assert [(status, content.media_type, content.example) for status, (content,) in made.answers] == [
        ("201", "text/csv", "")
    ]


def test_what_has_no_example_shows_none() -> None:
    assert example_of({"type": "array", "items": {"type": "number"}}, {}) is None


def test_every_json_body_and_answer_of_the_service_shows_an_example(tmp_path: Path) -> None:
    sections = reference(create_app(ServiceConfig(data_dir=tmp_path)).openapi())
    contents = [
        (each.path, one)
        for operations in sections.values()
        for each in operations
        for one in [*each.takes, *(content for _, answer in each.answers for content in answer)]
    ]
    assert len(contents) > 80
    bare = {path for path, one in contents if one.media_type == "application/json" and not one.example}
    # Documents that are described elsewhere: MODEL.json, and a laboratory's mapping.
    assert bare == {"/api/v1/models/import", "/api/v1/mappings"}
