"""Examples in the schema of the REST API: every body that is shown is taken, every record is what its schema says."""

from __future__ import annotations

import json
from typing import Any

import pytest

from bench_service.api.strict import Body
from bench_service.app.application import create_app
from bench_service.config import ServiceConfig
from tests.contract.json_schema import faults

# Bodies that are documents of their own, or bytes of a file: what they are stands elsewhere.
FREE = {"POST /api/v1/models/import", "POST /api/v1/mappings", "PUT /api/v1/imports/{import_id}/content"}


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    app = create_app(ServiceConfig(data_dir=tmp_path_factory.mktemp("data")))
    return json.loads(json.dumps(app.openapi(), allow_nan=False))


def bodies(kind: type[Body] = Body) -> dict[str, type[Body]]:
    """The models with which the service reads bodies, by the names of their schemas."""
    found = {each.__name__: each for each in kind.__subclasses__()}
    return found | {name: each for below in found.values() for name, each in bodies(below).items()}


def test_every_body_has_an_example_that_the_service_takes(document: dict[str, Any]) -> None:
    known, checked = bodies(), set()
    for address, methods in document["paths"].items():
        for method, operation in methods.items():
            name = f"{method.upper()} {address}"
            if "requestBody" not in operation or name in FREE:
                continue
            content = operation["requestBody"]["content"]["application/json"]
            assert "example" in content, f"{name} shows no body: add asked(...) beside its route"
            assert list(faults(content["example"], content["schema"], document["components"]["schemas"])) == [], name
            # A profile's schema stands in its own operation.
            model = content["schema"].get("$ref", "/ProfileBody").rsplit("/", 1)[1]
            known[model].model_validate_json(json.dumps(content["example"]))
            checked.add(name)
    assert len(checked) > 20 and "x-asked" not in json.dumps(document)


def test_every_other_answer_has_an_example_too(document: dict[str, Any]) -> None:
    shown = 0
    for address, methods in document["paths"].items():
        for method, operation in methods.items():
            done = next(each for code, each in operation["responses"].items() if code[0] == "2")
            content = done["content"].get("application/json")
            if content is None or "$ref" in json.dumps(content["schema"]):
                continue
            name = f"{method.upper()} {address}"
            assert "example" in content, f"{name} shows no answer: add shown(...) beside its route"
            assert list(faults(content["example"], content["schema"], document["components"]["schemas"])) == [], name
            shown += 1
    assert shown > 30 and "x-shown" not in json.dumps(document)


def test_every_record_has_an_example_that_is_what_its_schema_says(document: dict[str, Any]) -> None:
    schemas = document["components"]["schemas"]
    records = [name for name, schema in schemas.items() if "examples" in schema]
    assert {"Run", "Model", "Comparison", "Diagnosis", "Campaign", "Event", "Profile", "Cell", "Job"} <= set(records)
    for name in records:
        for example in schemas[name]["examples"]:
            assert list(faults(example, schemas[name], schemas)) == [], name
            assert set(example) == set(schemas[name]["properties"]), name
