"""Reports over REST."""

import pytest

from bench_service.api import reports
from bench_service.errors import ConflictError, NotFoundError
from bench_service.reports.pdf import NoPrinterError
from tests.unit.bench_service.api.route_rig import AsyncPart, client_of, error_of

PAGE = b"<!doctype html>"


@pytest.mark.parametrize(
    ("address", "call"),
    [("runs", "run"), ("campaigns", "campaign"), ("comparisons", "comparison"), ("diagnoses", "diagnosis"),
     ("trends", "trend"), ("designs", "design")],
)  # fmt: skip
def test_each_kind_is_a_page_that_loads_nothing(address: str, call: str) -> None:
    reporting = AsyncPart(**{call: PAGE})
    answer = client_of(reports.router, reporting=reporting).get(f"/{address}/x1/report")
    assert (answer.status_code, answer.content) == (200, PAGE)
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert reporting.calls == [(call, ("x1",), {})]


def test_on_paper_it_is_printed_and_named_without_what_a_client_sent() -> None:
    reporting = AsyncPart(run=PAGE, printed=b"%PDF-1.4")
    answer = client_of(reports.router, reporting=reporting).get('/runs/ab";12345678/report?format=pdf')
    assert (answer.content, answer.headers["content-type"]) == (b"%PDF-1.4", "application/pdf")
    assert answer.headers["content-disposition"] == 'inline; filename="run-ab1234.pdf"'
    assert reporting.calls[-1] == ("printed", (PAGE,), {})


def test_what_cannot_be_given_is_refused_with_a_reason() -> None:
    without = AsyncPart(run=PAGE, printed=NoPrinterError("install Chromium"))
    answer = client_of(reports.router, reporting=without).get("/runs/r1/report?format=pdf")
    assert answer.status_code == 501 and error_of(answer)["code"] == "no_pdf"
    missing = AsyncPart(run=NotFoundError.of("run", "r9"), trend=ConflictError("job j1 is queued", ("job",)))
    client = client_of(reports.router, reporting=missing)
    assert client.get("/runs/r9/report").status_code == 404
    assert client.get("/trends/j1/report").status_code == 409
    assert client.get("/runs/r9/report?format=docx").status_code == 422
