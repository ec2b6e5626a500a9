"""Campaigns over REST."""

from typing import Any

import pytest

from bench_service.api import campaigns
from bench_service.campaign.request import MOST_ROUNDS
from bench_service.errors import BenchBusyError, NotFoundError
from bench_service.store.records import CampaignRecord
from tests.unit.bench_service.api.route_rig import MOMENT, AsyncPart, client_of, error_of

RECORD = CampaignRecord(
    id="c1",
    name="one",
    bench="sim",
    state="running",
    stage="design",
    stages=({"name": "design", "state": "running", "detail": "", "seconds": None},),
    request={"bench": "sim"},
    created_utc=MOMENT,
    code_version="1",
)


def started(body: dict[str, Any]) -> tuple[Any, AsyncPart]:
    part = AsyncPart(start=RECORD)
    return client_of(campaigns.router, campaigns=part).post("/campaigns", json=body), part


def test_what_is_left_out_is_left_to_the_bench() -> None:
    answer, part = started({"bench": "sim"})
    assert answer.status_code == 201
    assert (answer.json()["id"], answer.json()["state"]) == ("c1", "running")
    ((_, (given,), _),) = part.calls
    assert given.pop("bench") == "sim"
    assert set(given.values()) == {None}


@pytest.mark.parametrize(
    ("field", "value", "taken"),
    [
        ("structure", "auto", True),
        ("structure", "bounded", True),
        ("structure", "deep", False),
        ("without", ["hysteresis", "relaxation"], True),
        ("without", "hysteresis", False),
        ("without", [1], False),
        ("rounds", MOST_ROUNDS, True),
        ("rounds", MOST_ROUNDS + 1, False),
        ("rounds", 0, False),
        ("dt_s", 1e-3, True),
        ("dt_s", 9e-4, False),
        ("dt_s", 3600, True),
        ("dt_s", 3601, False),
        ("soc", [0.1, 0.9], True),
        ("soc", [0.1, 1.1], False),
        ("current_A", [-5, 5], True),
        ("current_A", [-5], False),
        ("diagnose", "change", True),
        ("diagnose", "both", False),
        ("duration_s", 0, False),
        ("changed_bench", "aged", True),
        ("run", "r1", False),
    ],
)
def test_bounds_of_a_campaign(field: str, value: Any, taken: bool) -> None:
    answer, part = started({"bench": "sim", field: value})
    assert answer.status_code == (201 if taken else 422)
    assert len(part.calls) == taken
    if not taken:
        assert error_of(answer)["where"][0] == field


def test_a_bench_is_needed_and_a_busy_one_is_a_conflict() -> None:
    assert started({})[0].status_code == 422
    busy = AsyncPart(start=BenchBusyError("bench sim plays run r1"))
    answer = client_of(campaigns.router, campaigns=busy).post("/campaigns", json={"bench": "sim"})
    assert (answer.status_code, error_of(answer)["code"]) == (409, "bench_busy")


def test_pages_of_campaigns() -> None:
    part = AsyncPart(list=[RECORD])
    client = client_of(campaigns.router, campaigns=part)
    assert [each["id"] for each in client.get("/campaigns?limit=3&offset=7").json()["campaigns"]] == ["c1"]
    client.get("/campaigns")
    assert [tuple(named.values()) for *_, named in part.calls] == [(4, 7, None), (101, 0, None)]


@pytest.mark.parametrize("query", ["limit=0", "limit=1001", "offset=-1", "offset=1000000001", "limit=x"])
def test_pages_have_bounds(query: str) -> None:
    part = AsyncPart(list=[])
    assert client_of(campaigns.router, campaigns=part).get(f"/campaigns?{query}").status_code == 422
    assert part.calls == []


def test_one_is_given_and_stopped_by_its_id() -> None:
    part = AsyncPart(get=RECORD, stop=RECORD)
    client = client_of(campaigns.router, campaigns=part)
    assert client.get("/campaigns/c1").json()["id"] == client.post("/campaigns/c1/stop").json()["id"] == "c1"
    assert [(name, arguments) for name, arguments, _ in part.calls] == [("get", ("c1",)), ("stop", ("c1",))]
    nothing = AsyncPart(get=NotFoundError.of("campaign", "c9"))
    assert client_of(campaigns.router, campaigns=nothing).get("/campaigns/c9").status_code == 404
