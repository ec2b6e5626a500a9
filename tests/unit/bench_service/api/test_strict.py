"""Bodies are taken to the letter, and not beyond their length."""

import json
from collections.abc import AsyncIterator
from typing import Any

import pytest
from fastapi import APIRouter, Request

from bench_service.api.strict import (
    CSV_TYPE,
    JSON_TYPE,
    MAX_BODY_BYTES,
    MAX_BULK_BODY_BYTES,
    Body,
    BulkRoute,
    Id,
    Name,
    Number,
    Positive,
    Seed,
    Soc,
    StrictRoute,
    Window,
    read_json,
    require_content_type,
)
from tests.unit.bench_service.api.route_rig import Client, client_of, error_of


class EveryKind(Body):
    """One field of each kind."""

    name: Name = "a"
    id: Id = "a"
    number: Number = 0.0
    positive: Positive = 1.0
    soc: Soc = 0.5
    seed: Seed = 0
    window: Window = (0.0, 1.0)


def client(route_class: type[StrictRoute] = StrictRoute) -> Client:
    router = APIRouter(route_class=route_class)

    @router.post("/thing")
    async def post(body: EveryKind) -> dict[str, Any]:
        return body.model_dump()

    @router.post("/either")
    async def either(request: Request) -> dict[str, Any]:
        kind = require_content_type(request, JSON_TYPE, CSV_TYPE)
        if kind == CSV_TYPE:
            return {"bytes": len(await request.body())}
        return (await read_json(request, EveryKind)).model_dump()

    @router.post("/empty")
    async def empty() -> dict[str, Any]:
        return {}

    return client_of(router)


def post(body: str | bytes, address: str = "/thing", kind: str = JSON_TYPE) -> Any:
    return client().post(address, content=body, headers={"content-type": kind})


@pytest.mark.parametrize("address", ["/thing", "/either"])
@pytest.mark.parametrize(
    ("field", "value", "taken"),
    [
        ("number", 1, True),
        ("number", -1.5, True),
        ("number", "1", False),
        ("number", True, False),
        ("number", None, False),
        ("positive", 0, False),
        ("positive", 1e9, True),
        ("positive", 1.1e9, False),
        ("soc", 0, True),
        ("soc", 1, True),
        ("soc", 1.0001, False),
        ("soc", -0.0001, False),
        ("seed", 2**63 - 1, True),
        ("seed", 2**63, False),
        ("seed", -1, False),
        ("seed", 1.0, False),
        ("seed", True, False),
        ("window", [-1, 2.5], True),
        ("window", [1], False),
        ("window", [1, 2, 3], False),
        ("window", ["1", 2], False),
        ("name", "Zelle 1 ä", True),
        ("name", "", False),
        ("name", " a", False),
        ("name", "two\nlines", False),
        ("name", "x" * 200, True),
        ("name", "x" * 201, False),
        ("id", "x" * 64, True),
        ("id", "x" * 65, False),
        ("id", 7, False),
        ("colour", "red", False),
    ],
)
def test_values_are_taken_or_refused_at_their_place(address: str, field: str, value: Any, taken: bool) -> None:
    answer = post(json.dumps({field: value}), address)
    if taken:
        assert answer.status_code == 200 and answer.json()[field] == value
    else:
        assert answer.status_code == 422 and error_of(answer)["where"][0] == field


@pytest.mark.parametrize("address", ["/thing", "/either"])
@pytest.mark.parametrize(
    "body",
    [
        "{",
        '{"number": NaN}',
        '{"number": Infinity}',
        '{"number": -Infinity}',
        '{"number": 1, "number": 1}',
        '{"other": {"a": 1, "a": 2}}',
        "[" * 100_000,
        b"\xff\xfe{",
        '{"number": ' + "9" * 5000 + "}",
    ],
)
def test_what_is_no_json_by_the_standard_is_refused(address: str, body: str | bytes) -> None:
    answer = post(body, address)
    assert (answer.status_code, error_of(answer)["code"]) == (422, "bad_json")


def test_a_number_too_large_for_a_float_is_no_number() -> None:
    answer = post('{"number": 1e999}')
    assert (answer.status_code, error_of(answer)["code"]) == (422, "bad_request")


@pytest.mark.parametrize("body", ["", "null", "[]", "3", '"text"'])
def test_a_body_that_is_no_object_is_refused(body: str) -> None:
    assert post(body).status_code == 422
    assert post(body, "/either").status_code == 422


@pytest.mark.parametrize("kind", ["text/plain", "application/x-www-form-urlencoded", "", "application/jsonp"])
def test_another_content_type_is_refused_before_the_body_is_read(kind: str) -> None:
    answer = post("{", kind=kind)
    assert (answer.status_code, error_of(answer)["code"]) == (415, "wrong_content_type")
    assert JSON_TYPE in error_of(answer)["message"]


@pytest.mark.parametrize("kind", ["application/json; charset=utf-8", "APPLICATION/JSON", " application/json ;x"])
def test_parameters_and_case_of_the_content_type_do_not_matter(kind: str) -> None:
    assert post("{}", kind=kind).status_code == 200


def test_a_route_of_two_types_takes_both_and_no_third() -> None:
    assert post("a,b", "/either", CSV_TYPE).json() == {"bytes": 3}
    assert post("{}", "/either", JSON_TYPE).status_code == 200
    refused = post("{}", "/either", "text/html")
    assert refused.status_code == 415 and "application/json or text/csv" in error_of(refused)["message"]


def test_a_route_without_a_body_asks_for_no_content_type() -> None:
    assert client().post("/empty").status_code == 200


@pytest.mark.parametrize(("route_class", "most"), [(StrictRoute, MAX_BODY_BYTES), (BulkRoute, MAX_BULK_BODY_BYTES)])
def test_a_body_may_have_its_length_and_no_byte_more(route_class: type[StrictRoute], most: int) -> None:
    rig = client(route_class)
    headers = {"content-type": CSV_TYPE}
    assert rig.post("/either", content=b"x" * most, headers=headers).json() == {"bytes": most}
    answer = rig.post("/either", content=b"x" * (most + 1), headers=headers)
    assert (answer.status_code, error_of(answer)["code"]) == (413, "too_large")
    assert answer.headers["connection"] == "close"


def test_a_body_without_an_announced_length_is_counted() -> None:
    async def parts() -> AsyncIterator[bytes]:
        for _ in range(11):
            yield b"x" * (MAX_BODY_BYTES // 10)

    answer = client().post("/either", content=parts(), headers={"content-type": CSV_TYPE})
    assert answer.status_code == 413
    assert "more than 1000000 bytes" in error_of(answer)["message"]


@pytest.mark.parametrize("length", ["9" * 30, str(MAX_BODY_BYTES + 1)])
def test_an_announced_length_is_believed_at_once(length: str) -> None:
    answer = client().post("/either", content=b"x", headers={"content-type": CSV_TYPE, "content-length": length})
    assert answer.status_code == 413


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b'{"name": "a\\ud800b"}', "half of a pair of surrogates"),
        (b'{"\\uDFFF": 1}', "half of a pair of surrogates"),
        (b'{"name": "\xed\xa0\x80"}', "utf-8"),
        ('{"name": "\\ud800"}'.encode("utf-16"), "half of a pair of surrogates"),
        (b'{"name": "a\\u0000b"}', "a text holds NUL"),
        (b'{"name": "a\\\\\\u0000b"}', "a text holds NUL"),
        (b'{"number": 1%s}' % (b"0" * 400), "is larger than any number"),
        (b'{"number": 1%s}' % (b"0" * 5000), "Exceeds the limit"),
    ],
)
def test_what_nothing_behind_can_say_or_hold_is_no_json(content: bytes, told: str) -> None:
    answer = client().post("/thing", content=content, headers={"Content-Type": JSON_TYPE})
    assert answer.status_code == 422 and told in answer.text


def test_what_only_looks_like_it_is_taken() -> None:
    answer = client().post("/thing", content=b'{"name": "a\\\\u0000"}', headers={"Content-Type": JSON_TYPE})
    assert answer.json()["name"] == "a\\u0000"


def test_a_whole_pair_of_surrogates_is_a_character() -> None:
    content = b'{"name": "\\ud83d\\udd0b", "seed": 9007199254740993}'
    answer = client().post("/thing", content=content, headers={"Content-Type": JSON_TYPE})
    assert (answer.json()["name"], answer.json()["seed"]) == ("\U0001f50b", 9007199254740993)
