"""Benches over REST: what is asked of which part, and what the answers hold."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench_service.api import benches
from bench_service.errors import ConflictError, NotFoundError
from tests.unit.bench_service.api.route_rig import AsyncPart, Part, Store, client_of, error_of, run_record


def bench(name: str = "sim", state: str = "running") -> Any:
    status = SimpleNamespace(state=state)
    return SimpleNamespace(name=name, supervisor=SimpleNamespace(status=status), to_json=lambda: {"name": name})


class Benches(list[Any]):
    """A list of benches that can be asked for one."""

    def get(self, name: str) -> Any:
        found = [each for each in self if each.name == name]
        if not found:
            raise NotFoundError.of("bench", name)
        return found[0]


def test_all_of_them_and_one() -> None:
    client = client_of(benches.router, benches=Benches([bench("a"), bench("b")]))
    assert client.get("/benches").json() == {"benches": [{"name": "a"}, {"name": "b"}]}
    assert client.get("/benches/b").json() == {"name": "b"}


def test_an_unknown_bench_is_404_and_a_name_too_long_is_refused() -> None:
    client = client_of(benches.router, benches=Benches())
    assert client.get("/benches/none").status_code == 404
    assert client.get("/benches/" + "x" * 65).status_code == 422


def test_stopping_asks_the_runs_and_answers_with_the_state() -> None:
    every, runs = Benches([bench()]), Part(stop_bench=bench(state="stopping"))
    client = client_of(benches.router, benches=every, runs=runs)
    # No body is needed, whatever the type that a client claims.
    assert client.post("/benches/sim/stop").json() == {"state": "stopping"}
    assert runs.calls == [("stop_bench", (every, "sim", "stopped by a client"), {})]


def test_a_seal_is_opened_for_everybody() -> None:
    part = AsyncPart(open_seal={"effect": "hysteresis"})
    assert client_of(benches.router, benches=part).post("/benches/sim/seal/open").json() == {"effect": "hysteresis"}
    assert part.calls == [("open_seal", ("sim",), {})]
    sealed = AsyncPart(open_seal=ConflictError("nothing is hidden"))
    answer = client_of(benches.router, benches=sealed).post("/benches/sim/seal/open")
    assert (answer.status_code, error_of(answer)["message"]) == (409, "nothing is hidden")


def test_acknowledging_shows_the_bench() -> None:
    part = AsyncPart(acknowledge=bench("sim"))
    assert client_of(benches.router, benches=part).post("/benches/sim/acknowledge").json() == {"name": "sim"}
    assert part.calls == [("acknowledge", ("sim",), {})]


def test_looking_changes_nothing_and_stopping_is_no_reading() -> None:
    client = client_of(benches.router, benches=Benches([bench()]))
    assert client.get("/benches/sim/stop").status_code == 405
    assert client.post("/benches").status_code == 405


@pytest.mark.parametrize(("simulated", "played", "soc"), [(True, True, 0.4), (True, False, 0.9), (False, False, None)])
def test_where_a_cell_stands_is_told_as_far_as_it_is_known(simulated: bool, played: bool, soc: float | None) -> None:
    config = SimpleNamespace(simulate=SimpleNamespace(initial_soc=0.9) if simulated else None)
    one = SimpleNamespace(name="sim", config=config, runs_before_cell=0, cell=None, cell_since_utc=None)
    data = SimpleNamespace(n=2, columns={"time_s": np.array([0.0, 360.0]), "current_A": np.array([0.0, -2.0])})
    store = Store(runs={"page": [run_record(n_samples=2)] if played else []})
    client = client_of(benches.router, benches=Benches([one]), store=store, samples=Part(read=data))
    answer = client.get("/benches/sim/standing")
    if soc is None:
        assert answer.status_code == 404
        assert "not known" in error_of(answer)["message"]
    else:
        assert answer.json()["soc"] == pytest.approx(soc)
