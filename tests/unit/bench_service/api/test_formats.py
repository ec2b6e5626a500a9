"""Formats that a run can be exported to, as the page learns of them."""

from bench_service.api import formats, samples
from bench_service.exchange.write import export_formats
from bench_service.store.reading import StreamData
from tests.unit.bench_service.api.route_rig import Part, Store, client_of, error_of, run_record


def test_every_format_that_can_be_written_is_listed_once() -> None:
    listed = client_of(formats.router).get("/formats").json()["formats"]
    assert [each["name"] for each in listed] == [*export_formats(), "ro-crate"]


def test_what_is_listed_can_be_asked_for() -> None:
    """A run without samples is a conflict in a format that is known, and a bad request in one that is not."""
    parts = {"store": Store(runs={"get": run_record()}), "samples": Part(read=StreamData.empty())}
    client = client_of(formats.router, samples.router, **parts)
    for each in client.get("/formats").json()["formats"]:
        assert error_of(client.get(f"/runs/r1/export?format={each['name']}"))["code"] == "conflict"
    assert error_of(client.get("/runs/r1/export?format=none"))["code"] == "bad_file"
