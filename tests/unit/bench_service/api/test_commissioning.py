"""Commissioning over REST: read only unless it is confirmed."""

from types import SimpleNamespace
from typing import Any

import pytest

from bench_service.api import commissioning
from bench_service.bench.commissioning.check import ProofOrder
from bench_service.errors import BenchBusyError
from tests.unit.bench_service.api.route_rig import AsyncPart, Part, client_of, error_of

BENCHES = Part(get=SimpleNamespace(config=SimpleNamespace(settle_s=0.5)))


@pytest.mark.parametrize(
    ("body", "order"),
    [
        ({}, ProofOrder(settle_s=0.5)),
        ({"confirm": True, "current_A": 1.5}, ProofOrder(True, 1.5, None, 0.5)),
        ({"confirm": True, "resistor_Ohm": 2.0}, ProofOrder(True, None, 2.0, 0.5)),
    ],
)
def test_what_is_asked_for_reaches_the_bench(body: dict[str, Any], order: ProofOrder) -> None:
    part = AsyncPart(commission={"state": "passed"})
    client = client_of(commissioning.router, commissioning=part, benches=BENCHES)
    assert client.post("/benches/left/commission", json=body).json() == {"state": "passed"}
    assert part.calls == [("commission", ("left", order), {})]


@pytest.mark.parametrize("body", [{"confirm": 1}, {"current_A": 0}, {"resistor_Ohm": -1.0}, {"yes": True}])
def test_a_bad_body_is_refused(body: dict[str, Any]) -> None:
    client = client_of(commissioning.router, commissioning=AsyncPart(), benches=BENCHES)
    assert client.post("/benches/left/commission", json=body).status_code == 422


def test_a_busy_bench_is_409() -> None:
    part = AsyncPart(commission=BenchBusyError("bench 'left' is busy"))
    answer = client_of(commissioning.router, commissioning=part, benches=BENCHES).post(
        "/benches/left/commission", json={}
    )
    assert (answer.status_code, error_of(answer)["message"]) == (409, "bench 'left' is busy")


def test_the_standing_is_given() -> None:
    part = Part(standing={"bench": "left", "state": "missing"})
    client = client_of(commissioning.router, commissioning=part)
    assert client.get("/benches/left/commissioning").json() == {"bench": "left", "state": "missing"}
