"""Which status and code each kind of error becomes, and what of it a client may see."""

from http import HTTPStatus
from typing import Any

import pytest
from fastapi import APIRouter, Query
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from bench_service.api.errors import error_response
from bench_service.campaign.live import TooManyReadersError
from bench_service.errors import (
    BadRequestError,
    BenchBusyError,
    BenchOfflineError,
    ConflictError,
    NotFoundError,
    ServiceError,
    StoreError,
)
from bench_service.exchange.errors import ExchangeError, UnknownFormatError
from models.data.errors import ModelError, StructureError
from tests.unit.bench_service.api.route_rig import client_of, error_of


def answer_to(error: Exception):  # noqa: ANN201
    router = APIRouter()

    @router.get("/thing")
    def thing(number: int = Query(default=0)) -> dict[str, Any]:
        raise error

    return client_of(router).get("/thing")


@pytest.mark.parametrize(
    ("error", "status", "code"),
    [
        (NotFoundError.of("run", "r9"), 404, "not_found"),
        (ConflictError("the run has ended"), 409, "conflict"),
        (BenchBusyError("busy"), 409, "bench_busy"),
        (BadRequestError("too much"), 422, "bad_request"),
        (BenchOfflineError("away"), 503, "bench_offline"),
        (StoreError("disk full"), 503, "store"),
        (TooManyReadersError("20 readers"), 503, "too_many_readers"),
        (ExchangeError("no such column"), 422, "bad_file"),
        (UnknownFormatError("mp3"), 422, "bad_file"),
        (ModelError("no excitation"), 422, "not_identifiable"),
        (StructureError("unknown signal"), 422, "not_identifiable"),
        (ServiceError("something"), 500, "error"),
    ],
)
def test_each_error_has_its_status_and_code(error: Exception, status: int, code: str) -> None:
    answer = answer_to(error)
    assert answer.status_code == status
    assert error_of(answer) == {"code": code, "message": str(error), "where": error_of(answer)["where"]}


def test_the_place_in_the_request_is_given_where_it_is_known() -> None:
    bad = BadRequestError("current above the limit", ("current_A", 17), value=9.0, unit="A", limit=5.0)
    assert error_of(answer_to(bad))["where"] == ["current_A", 17]
    assert error_of(answer_to(ConflictError("no")))["where"] is None
    assert error_of(answer_to(ModelError("no")))["where"] is None


@pytest.mark.parametrize("error", [ValueError("secret"), KeyError("secret"), RuntimeError("secret")])
def test_what_nobody_expected_is_500_and_tells_nothing(error: Exception) -> None:
    answer = answer_to(error)
    assert (answer.status_code, error_of(answer)["code"]) == (500, "internal")
    assert "secret" not in answer.text


def test_http_errors_take_the_form_and_keep_their_headers() -> None:
    answer = answer_to(HTTPException(413, "too long", headers={"Connection": "close"}))
    assert (answer.status_code, error_of(answer)["code"]) == (413, "too_large")
    assert answer.headers["connection"] == "close"
    assert error_of(answer_to(HTTPException(418, "teapot")))["code"] == "error"


def test_an_address_that_is_not_there_is_named() -> None:
    client = client_of(APIRouter())
    answer = client.get("/nowhere")
    assert answer.status_code == 404
    assert error_of(answer)["message"] == "no such address: /nowhere"
    # Not the whole of what somebody sends comes back.
    assert len(error_of(client.get("/" + "x" * 5000))["message"]) < 300


def test_a_method_that_is_not_there_is_405() -> None:
    router = APIRouter()
    router.get("/thing")(lambda: {})
    answer = client_of(router).post("/thing")
    assert (answer.status_code, error_of(answer)["code"]) == (405, "method_not_allowed")


def test_a_bad_query_is_told_by_its_name_and_never_repeated() -> None:
    router = APIRouter()
    router.get("/thing")(_two_numbers)
    answer = client_of(router).get("/thing", params={"first": "<script>", "second": "x"})
    assert answer.status_code == 422
    error = error_of(answer)
    assert error["where"] == ["first"]
    assert error["message"].startswith("first: ") and error["message"].endswith("(and 1 more)")
    assert "<script>" not in answer.text


def _two_numbers(first: int, second: int) -> dict[str, Any]:
    return {"sum": first + second}


def test_text_that_is_no_utf8_is_shown_with_replacements() -> None:
    answer = error_response(422, "bad_request", "key \ud800", ["a\udfff", 3])
    assert answer.body == b'{"error":{"code":"bad_request","message":"key ?","where":["a?",3]}}'


def test_an_upload_that_is_given_up_is_no_error_of_the_service(caplog: pytest.LogCaptureFixture) -> None:
    """Raised through, it was one line and forty of a traceback in the log for each."""
    router = APIRouter()

    @router.post("/take")
    async def take() -> None:
        raise ClientDisconnect

    client = client_of(router)
    assert client.post("/take").status_code == 400
    assert caplog.text == ""


def test_who_accepts_a_problem_gets_one() -> None:
    router = APIRouter()

    @router.get("/thing")
    def thing() -> dict[str, Any]:
        raise BadRequestError("too much", ("dt_s",), value=7, unit="s")

    client = client_of(router)
    own = error_of(client.get("/thing"))
    answer = client.get("/thing", headers={"Accept": "application/problem+json, application/json;q=0.5"})
    assert answer.headers["content-type"] == "application/problem+json" and answer.status_code == 422
    assert answer.json() == {
        "type": "about:blank",
        "title": HTTPStatus(422).phrase,
        "status": 422,
        "detail": own["message"],
        "code": "bad_request",
        "where": ["dt_s"],
    }
    unknown = client.get("/nothing", headers={"Accept": "application/problem+json"})
    assert (unknown.json()["status"], unknown.json()["code"]) == (404, "not_found")
