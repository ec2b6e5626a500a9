"""What an operation answers with stands beside its route, and becomes the schema of its answer."""

from typing import Any

import pytest
from fastapi import APIRouter, FastAPI

from bench_service.api.answers import files, job, keyed, listed, record
from bench_service.api.response_schemas import described


def document_of(said: dict[str, Any] | None) -> dict[str, Any]:
    app, router = FastAPI(), APIRouter()

    @router.get("/thing", openapi_extra=said)
    def thing() -> dict[str, str]:
        return {}

    app.include_router(router)
    return described(app.openapi())["paths"]["/thing"]["get"]


def test_each_kind_of_answer_has_its_schema() -> None:
    runs = {"type": "array", "items": {"$ref": "#/components/schemas/Run"}}
    for said, schema in (
        (record("Run"), {"$ref": "#/components/schemas/Run"}),
        (job(), {"$ref": "#/components/schemas/Job"}),
        (listed("runs", "Run"), {"type": "object", "properties": {"runs": runs}, "required": ["runs"]}),
        (keyed("a", "b"), {"type": "object", "properties": {"a": {}, "b": {}}, "required": ["a", "b"]}),
    ):
        told = document_of(said)
        assert told["responses"]["200"]["content"] == {"application/json": {"schema": schema}}
        assert "x-answer" not in told
    told = document_of(files("text/csv", "application/zip"))
    assert list(told["responses"]["200"]["content"]) == ["text/csv", "application/zip"]


def test_a_route_that_says_nothing_is_named() -> None:
    with pytest.raises(LookupError, match="GET /thing does not say what it answers with"):
        document_of(None)
