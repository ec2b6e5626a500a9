"""Events over REST."""

from bench_service.api import events
from bench_service.errors import NotFoundError
from bench_service.store.records import EventRecord
from tests.unit.bench_service.api.route_rig import MOMENT, Store, client_of, run_record

EVENT = EventRecord(
    id=7, created_utc=MOMENT, severity="warning", code="trip", text="too warm", bench="sim", run_id="r1",
    campaign_id=None,
)  # fmt: skip

NEWEST = {"limit": 101, "offset": 0, "after": None}  # one more than goes out tells whether there are more


def test_the_newest_of_all() -> None:
    store = Store(events={"page": [EVENT]})
    client = client_of(events.router, store=store)
    (one,) = client.get("/events?limit=1&offset=4").json()["events"]
    assert (one["id"], one["severity"], one["text"]) == (7, "warning", "too warm")
    assert store.calls == [("events.page", (), {"limit": 2, "offset": 4, "after": None})]


def test_those_of_one_run() -> None:
    store = Store(runs={"get": run_record()}, events={"page": [EVENT]})
    assert len(client_of(events.router, store=store).get("/runs/r1/events").json()["events"]) == 1
    assert store.calls == [("runs.get", ("r1",), {}), ("events.page", ("r1",), NEWEST)]


def test_a_run_that_is_not_there_has_no_empty_list_but_404() -> None:
    store = Store(runs={"get": NotFoundError.of("run", "r9")}, events={"page": []})
    assert client_of(events.router, store=store).get("/runs/r9/events").status_code == 404
