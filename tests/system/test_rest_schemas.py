"""What the service's schema says of its answers, held against answers of a real service."""

from __future__ import annotations

from typing import Any

import httpx
import pytest
from rest_rig import Rest

from tests.contract.json_schema import faults
from tests.patience import PATIENCE_S


@pytest.fixture(scope="module")
def document(rest: Rest) -> dict[str, Any]:
    return rest.get("/api/v1/openapi.json").json()


def operations(document: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {
        f"{method.upper()} {address}": told
        for address, methods in document["paths"].items()
        for method, told in methods.items()
    }


def is_file(told: dict[str, Any]) -> bool:
    return "application/json" not in next(each for code, each in told["responses"].items() if code[0] == "2")["content"]


def test_every_operation_says_what_it_answers_with_and_how_it_refuses(document: dict[str, Any]) -> None:
    assert len(operations(document)) > 90
    for operation, told in operations(document).items():
        assert "x-answer" not in told, operation
        (done,) = [code for code in told["responses"] if code.startswith("2")]
        assert told["responses"][done]["content"], operation
        assert set(told["responses"]["default"]["content"]) == {"application/json", "application/problem+json"}


def test_answers_are_what_their_schema_says(rest: Rest, document: dict[str, Any]) -> None:
    rest.service.idle("sim")
    client = rest.client
    cell = client.add_cell(label="left", metadata={"batch": 7})
    client.put_cell("sim", cell["id"])
    rest.service.idle("sim")
    run = client.start_run("sim", rest.profile_id, 0.1, 0.5, cell_id=cell["id"])
    run = client.wait_run(run["id"], timeout_s=PATIENCE_S)
    protocol = client.add_standard_test("pulse_resistance", "sim")
    names = {"name": "sim", "cell_id": cell["id"], "run_id": run["id"], "profile_id": rest.profile_id}
    names |= {"protocol_id": protocol["id"]}
    checked = set()
    for operation, told in operations(document).items():
        method, _, address = operation.partition(" ")
        needed = {part[1:-1] for part in address.split("/") if part.startswith("{")}
        if method != "GET" or is_file(told) or not needed <= set(names):
            continue
        answer = httpx.get(f"{rest.service.url}{address.format(**names)}", timeout=PATIENCE_S)
        assert answer.status_code == 200, f"{operation}: {answer.text[:200]}"
        schema = told["responses"]["200"]["content"]["application/json"]["schema"]
        found = list(faults(answer.json(), schema, document["components"]["schemas"]))
        assert found == [], f"{operation}: {found[:5]}"
        checked.add(operation)
    assert len(checked) > 25
    wrong = httpx.get(f"{rest.service.url}/api/v1/runs/none")
    assert list(faults(wrong.json(), {"$ref": "#/components/schemas/Error"}, document["components"]["schemas"])) == []
