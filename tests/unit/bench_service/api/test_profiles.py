"""Profiles over REST: as JSON or as CSV, checked before they are stored."""

import gzip
import json
from typing import Any

import numpy as np
import pytest

from bench_service.api import profiles
from bench_service.api.strict import MAX_BODY_BYTES
from bench_service.store.records import ProfileRecord
from tests.unit.bench_service.api.route_rig import MOMENT, AsyncPart, Store, client_of, error_of

RECORD = ProfileRecord("p1", "steps", "abc", 3, 20.0, (-2.0, 1.5), (0.0, 0.0, 0.0), MOMENT)
CSV = "time_s,current_A\n0,1.5\n10,-2\n20,0\n"


class Journal(AsyncPart):
    """Notes what is written, and says that it is."""

    def __init__(self) -> None:
        super().__init__(write=RECORD)


def sent(body: str | bytes, kind: str, query: str = "") -> tuple[Any, Journal]:
    journal, store = Journal(), Store(profiles={"add": RECORD})
    client = client_of(profiles.router, journal=journal, store=store)
    return client.post(f"/profiles{query}", content=body, headers={"content-type": kind}), journal


def stored(journal: Journal) -> tuple[str, list[float], list[float]]:
    ((_, (_, name, time_s, current_A), _),) = journal.calls
    return name, np.asarray(time_s).tolist(), np.asarray(current_A).tolist()


def test_the_same_profile_as_json_and_as_csv() -> None:
    body = json.dumps({"name": "steps", "time_s": [0, 10, 20], "current_A": [1.5, -2, 0]})
    as_json, first = sent(body, "application/json")
    as_csv, second = sent(CSV, "text/csv; charset=utf-8", "?name=steps")
    assert as_json.status_code == as_csv.status_code == 201
    assert as_json.json()["id"] == "p1"
    assert stored(first) == stored(second) == ("steps", [0.0, 10.0, 20.0], [1.5, -2.0, 0.0])


@pytest.mark.parametrize(
    ("body", "kind", "query", "status"),
    [
        (CSV, "text/csv", "", 422),  # its name is missing
        (CSV, "text/csv", "?name=", 422),
        (CSV, "text/plain", "?name=x", 415),
        (CSV, "application/json", "?name=x", 422),
        (gzip.compress(CSV.encode(), mtime=0), "text/csv", "?name=x", 422),
        ('{"name":"x","time_s":[0,1],"current_A":[NaN,0]}', "application/json", "", 422),
        ('{"name":"x","time_s":[0,1],"current_A":["1",0]}', "application/json", "", 422),
        ('{"name":"x","time_s":[0,1],"current_A":[1,0],"unit":"mA"}', "application/json", "", 422),
        ('{"name":"x","time_s":[0,1],"current_A":[1]}', "application/json", "", 422),
        ('{"name":"x","time_s":[1,0],"current_A":[1,0]}', "application/json", "", 422),
        ('{"name":"x","time_s":[],"current_A":[]}', "application/json", "", 422),
    ],
)
def test_what_is_no_profile_is_refused_and_not_stored(body: str | bytes, kind: str, query: str, status: int) -> None:
    answer, journal = sent(body, kind, query)
    assert answer.status_code == status
    assert error_of(answer)["message"]
    assert journal.calls == []


def test_a_name_is_missing_at_its_place() -> None:
    assert error_of(sent(CSV, "text/csv")[0])["where"] == ["name"]


def test_a_profile_may_be_longer_than_other_bodies() -> None:
    n = MAX_BODY_BYTES // 10
    body = json.dumps({"name": "long", "time_s": list(range(n)), "current_A": [0.25] * n})
    assert len(body) > MAX_BODY_BYTES
    assert sent(body, "application/json")[0].status_code == 201


def test_points_are_given_where_they_are_asked_for() -> None:
    points = np.array([0.0, 20.0]), np.array([1.5, 0.0])
    store = Store(profiles={"get": RECORD, "points": points, "page": [RECORD]})
    client = client_of(profiles.router, store=store)
    assert "time_s" not in client.get("/profiles/p1").json()
    whole = client.get("/profiles/p1?points=true").json()
    assert (whole["time_s"], whole["current_A"]) == ([0.0, 20.0], [1.5, 0.0])
    assert whole["n_points"] == 3 and whole["charge_Ah"] == [0.0, 0.0, 0.0]
    assert client.get("/profiles").json()["profiles"][0]["id"] == "p1"
    assert client.get("/profiles/p1?points=perhaps").status_code == 422
