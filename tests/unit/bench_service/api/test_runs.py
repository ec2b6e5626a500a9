"""Runs over REST."""

from typing import Any

import pytest

from bench_service.api import runs
from bench_service.campaign.ordering import RunOrder
from bench_service.campaign.run_models import BandWish
from bench_service.errors import BenchOfflineError, NotFoundError
from tests.unit.bench_service.api.route_rig import AsyncPart, Part, Store, client_of, error_of, run_record

BODY = {"bench": "sim", "profile_id": "p1", "dt_s": 0.1, "initial_soc": 0.5}
BENCHES = object()


def started(changes: dict[str, Any]) -> tuple[Any, AsyncPart]:
    part = AsyncPart(start=run_record(state="running"))
    return client_of(runs.router, runs=part, benches=BENCHES).post("/runs", json=BODY | changes), part


def test_an_order_goes_on_as_it_was_given() -> None:
    limits = {"voltage_V": [3.0, 4.2], "ramp_A_per_s": 5}
    observer = {"model_id": "m1", "observer_initial_soc": 0.6, "observer_gain": "steady"}
    answer, part = started({"limits": limits, "seed": 3} | observer)
    assert (answer.status_code, answer.json()["state"]) == (201, "running")
    ((_, (benches, order), _),) = part.calls
    assert benches is BENCHES
    assert (order.bench, order.profile_id, order.dt_s, order.initial_soc) == ("sim", "p1", 0.1, 0.5)
    assert (order.model_id, order.observer_initial_soc, order.observer_gain, order.seed) == ("m1", 0.6, "steady", 3)
    given = {name: value for name, value in order.limits.items() if value is not None}
    assert given == {"voltage_V": (3.0, 4.2), "ramp_A_per_s": 5.0}


def test_limits_that_are_left_out_are_the_benchs_own() -> None:
    assert started({})[1].calls[0][1][1] == RunOrder(bench="sim", profile_id="p1", dt_s=0.1, initial_soc=0.5)


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"dt_s": 9e-4}, ["dt_s"]),
        ({"dt_s": 3601}, ["dt_s"]),
        ({"initial_soc": 1.01}, ["initial_soc"]),
        ({"initial_soc": None}, ["initial_soc"]),
        ({"observer_initial_soc": -0.1}, ["observer_initial_soc"]),
        ({"observer_gain": "best"}, ["observer_gain"]),
        ({"limits": {"voltage_V": [3.0]}}, ["limits", "voltage_V", 1]),
        ({"limits": {"voltage_v": [3.0, 4.2]}}, ["limits", "voltage_v"]),
        ({"limits": {"ramp_A_per_s": 0}}, ["limits", "ramp_A_per_s"]),
        ({"campaign_id": "c1"}, ["campaign_id"]),  # only a campaign says that of its own runs
        ({"name": " x"}, ["name"]),
    ],
)
def test_an_order_that_is_none_is_refused_at_its_place(changes: dict[str, Any], where: list[Any]) -> None:
    answer, part = started(changes)
    assert (answer.status_code, error_of(answer)["where"]) == (422, where)
    assert part.calls == []


def test_a_bench_that_is_away_is_no_fault_of_the_client() -> None:
    part = AsyncPart(start=BenchOfflineError("bench sim is offline"))
    answer = client_of(runs.router, runs=part, benches=BENCHES).post("/runs", json=BODY)
    assert (answer.status_code, error_of(answer)["code"]) == (503, "bench_offline")


def test_a_list_is_narrowed_by_bench_state_and_campaign() -> None:
    store = Store(runs={"page": [run_record()]})
    client = client_of(runs.router, store=store)
    assert client.get("/runs").json()["runs"][0]["id"] == "r1"
    client.get("/runs?bench=sim&state=fault&campaign_id=c1&limit=2&offset=1")
    named = {"words": None, "cell_id": None, "after": None}
    assert [call[1:] for call in store.calls] == [
        ((None, None, None), named | {"limit": 101, "offset": 0}),
        (("sim", "fault", "c1"), named | {"limit": 3, "offset": 1}),
    ]
    assert client.get("/runs?state=broken").status_code == 422


def test_stopping_a_run_answers_with_it() -> None:
    record = run_record(state="running")
    part, store = Part(stop=None), Store(runs={"get": record})
    answer = client_of(runs.router, runs=part, store=store, benches=BENCHES).post("/runs/r1/stop")
    assert answer.json()["id"] == "r1"
    assert part.calls == [("stop", (BENCHES, record, "stopped by a client"), {})]


def test_a_run_that_is_not_there_is_neither_given_nor_stopped() -> None:
    part, store = Part(stop=None), Store(runs={"get": NotFoundError.of("run", "r9")})
    client = client_of(runs.router, runs=part, store=store, benches=BENCHES)
    assert client.get("/runs/r9").status_code == client.post("/runs/r9/stop").status_code == 404
    assert part.calls == []


def test_a_band_names_its_model_and_how_far_and_long() -> None:
    assert started({"band": {"model_id": "m1"}})[1].calls[0][1][1].band == BandWish(model_id="m1")
    given = {"model_id": "m1", "margin_V": 0.1, "for_s": 5.0}
    assert started({"band": given})[1].calls[0][1][1].band == BandWish(**given)
    assert started({"band": {"model_id": "m1", "margin_V": 0.0}})[0].status_code == 422


class Journal(AsyncPart):
    """Writes at once, and keeps what is noted."""

    def __init__(self) -> None:
        super().__init__()
        self.noted: list[Any] = []

    async def write(self, function: Any, *arguments: Any) -> Any:
        return function(*arguments)

    def note(self, bench: str, event: Any) -> None:
        self.noted.append((bench, event["code"], event["text"]))


def described(body: dict[str, Any]) -> tuple[Any, Store, list[Any]]:
    before = run_record(label="old", notes="a\nb")
    store, journal = Store(runs={"describe": (before, run_record(label="new"))}), Journal()
    client = client_of(runs.router, store=store, journal=journal)
    return client.request("PATCH", "/runs/r1", json=body), store, journal.noted


def test_what_a_person_says_of_a_run_is_kept_with_what_stood_there_before() -> None:
    answer, store, noted = described({"label": "new", "notes": None})
    assert (answer.status_code, answer.json()["label"]) == (200, "new")
    assert store.calls[0][1] == ("r1", {"label": "new", "notes": None})
    assert noted == [("sim", "run_described", "run 'r1': label 'new', was 'old'; notes taken away, was 'a b'")]


def test_what_changes_nothing_is_no_event_and_what_is_no_text_is_refused() -> None:
    assert described({"label": "old"})[2] == []
    for body in ({"label": ""}, {"operator": "a\tb"}, {"notes": 3}, {"joy": "x"}):
        assert described(body)[0].status_code == 422


def test_runs_are_looked_for_by_words() -> None:
    store = Store(runs={"page": [run_record()]})
    assert client_of(runs.router, store=store).get("/runs?q=formation%20b&state=completed").status_code == 200
    assert store.calls[0][1] == (None, "completed", None) and store.calls[0][2]["words"] == "formation b"


def test_a_run_that_is_learned_from_goes_another_way() -> None:
    learning, plain = AsyncPart(start_run=run_record(state="running")), AsyncPart(start=run_record(state="running"))
    client = client_of(runs.router, runs=plain, learning=learning, benches=BENCHES)
    assert client.post("/runs", json=BODY | {"model_id": "m1", "learn": True}).status_code == 201
    ((_, (benches, order), _),) = learning.calls
    assert benches is BENCHES and order.model_id == "m1" and plain.calls == []
    assert client.post("/runs", json=BODY | {"learn": "yes"}).status_code == 422
