"""Cells over REST: bodies to the letter, pages by cursor, and what a bench becomes with a cell on it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Any, cast

import pytest

from bench_service.api import cells, runs
from bench_service.bench.limits import Limits
from bench_service.bench.supervisor import BenchSupervisor
from bench_service.campaign.benches import Bench
from bench_service.campaign.cell_of_run import check_cell
from bench_service.campaign.cell_on_bench import with_cell
from bench_service.campaign.cells import Cells
from bench_service.config import BenchConfig, LimitsConfig, SimulateConfig
from bench_service.errors import BadRequestError, ConflictError, NotFoundError
from bench_service.store.cells import CellRecord
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunIntent
from tests.unit.bench_service.api.route_rig import Client, client_of, error_of

TYPE = {
    "maker": "Maker",
    "model": "M50",
    "chemistry": "NMC",
    "capacity_Ah": 5.0,
    "voltage_V": [2.5, 4.2],
    "charge_A": 4.0,
    "discharge_A": 7.5,
    "temperature_degC": [0, 45],
    "source": "data sheet",
}


class Status:
    state, reason, run_id, capabilities, identity, chamber = "offline", None, None, None, None, None


class Supervisor:
    """As much of one as is asked; it has no process yet and takes what it is told for its next one."""

    pid, status, stop_endpoint = None, Status(), None

    def __init__(self, name: str) -> None:
        self.name, self.told = name, dict[str, Any]()

    def renew(self, **settings: Any) -> None:
        self.told = settings


def bench(name: str = "left", *, real: bool = True, **more: Any) -> Bench:
    limits = LimitsConfig(voltage_V=(2.0, 4.1), current_A=(-10.0, 5.0), temperature_degC=(-20.0, 60.0))
    kind = {"url": "modbus-tcp://127.0.0.1:1"} if real else {"simulate": SimulateConfig()}
    config = BenchConfig(**kind, limits=limits, capacity_Ah=2.0, **more)
    told = Limits.from_json(config.limits.model_dump())
    return Bench(config, "x", told, cast(BenchSupervisor, Supervisor(name)))


class Journal:
    def __init__(self, store: MetadataStore) -> None:
        self._store, self.noted = store, list[tuple[str, str | None]]()

    async def write(self, function: Any, *arguments: Any) -> Any:
        return function(*arguments)

    def note(self, bench: str | None, event: Any, campaign_id: str | None = None, cell_id: str | None = None) -> None:
        self.noted.append((event["text"], cell_id))
        self._store.events.add(event["severity"], event["code"], event["text"], bench=bench, cell_id=cell_id)


class Benches(dict[str, Bench]):
    """All benches by name."""

    def __iter__(self) -> Any:
        return iter(list(self.values()))

    def get(self, name: str) -> Bench:  # pyright: ignore[reportIncompatibleMethodOverride]
        if name not in self.keys():
            raise NotFoundError.of("bench", name)
        return self[name]

    def publish(self, _bench: Bench) -> None: ...


class Parts:
    """The service's parts over a store of their own."""

    busy: str | None = None

    def __init__(self, store: MetadataStore) -> None:
        self.store, self.journal = store, Journal(store)
        self.benches = Benches({name: bench(name) for name in ("left", "right")})

    def is_running(self, name: str) -> bool:
        return name == self.busy

    def claimed(self, _bench: Bench) -> Any:
        return nullcontext()

    def client(self) -> Client:
        part = cast(Any, self)
        service = Cells(self.store, part.journal, part.benches, part, part)
        return client_of(
            cells.router, runs.router, cells=service, store=self.store, benches=self.benches, journal=self.journal
        )


@pytest.fixture
def parts(tmp_path: Path) -> Iterator[Parts]:
    with closing(MetadataStore.open(tmp_path)) as store:
        yield Parts(store)


def test_a_cell_is_taken_in_changed_and_retired_with_a_trace(parts: Parts) -> None:
    client = parts.client()
    made = client.post("/cells", json={"label": "left 3", "owner": "Ana", "type": TYPE, "metadata": {"mass_g": 68.2}})
    assert (made.status_code, made.json()["id"], made.json()["type"]["resistance_Ohm"]) == (201, "C1", None)
    assert client.post("/cells", json={"id": "LG-7", "like": "c1"}).json()["type"]["model"] == "M50"
    changed = client.request("PATCH", "/cells/c1", json={"owner": None, "capacity_Ah": 4.8})
    assert (changed.json()["owner"], changed.json()["capacity_Ah"], changed.json()["label"]) == (None, 4.8, "left 3")
    assert client.post("/cells/C1/retire").json()["retired_utc"] is not None
    assert [each["id"] for each in client.get("/cells").json()["cells"]] == ["LG-7"]
    assert [each["id"] for each in client.get("/cells?retired=true&q=mass 68").json()["cells"]] == ["C1"]
    assert client.post("/cells/C1/reuse").json()["retired_utc"] is None
    texts = [each["text"] for each in client.get("/cells/C1/events").json()["events"]]
    assert texts[::-1] == [
        "cell C1 (left 3) is taken in",
        "cell C1 (left 3): owner None, was Ana; capacity_Ah 4.8, was None",
        "cell C1 (left 3) is retired",
        "cell C1 (left 3) is used again",
    ]
    client.request("PATCH", "/cells/c1", json={"capacity_Ah": 4.8})
    assert len(client.get("/cells/C1/events").json()["events"]) == 4  # nothing has changed


def test_pages_go_on_where_the_last_one_ended(parts: Parts) -> None:
    client = parts.client()
    for _ in range(3):
        client.post("/cells", json={})
    first = client.get("/cells?limit=2").json()
    second = client.get(f"/cells?limit=2&cursor={first['next_cursor']}").json()
    assert [each["id"] for each in first["cells"] + second["cells"]] == ["C3", "C2", "C1"]
    assert second["next_cursor"] is None


@pytest.mark.parametrize(
    ("body", "where"),
    [
        ({"id": "a b"}, ["id"]),
        ({"colour": "red"}, ["colour"]),
        ({"metadata": {"a": [1]}}, ["metadata"]),
        ({"metadata": {"a": None}}, ["metadata"]),
        ({"capacity_Ah": -1}, ["capacity_Ah"]),
        ({"type": TYPE | {"voltage_V": [4.2, 2.5]}}, ["type", "voltage_V"]),
        ({"type": {name: value for name, value in TYPE.items() if name != "source"}}, ["type", "source"]),
        ({"type": TYPE | {"joy": 1}}, ["type", "joy"]),
        ({"type": TYPE, "like": "C1"}, ["like"]),
    ],
)
def test_what_is_no_cell_is_refused_at_its_place(parts: Parts, body: dict[str, Any], where: list[Any]) -> None:
    answer = parts.client().post("/cells", json=body)
    assert (answer.status_code, error_of(answer)["where"]) == (422, where)
    assert parts.store.cells.page() == []


def test_an_id_that_is_taken_and_one_that_is_not_there(parts: Parts) -> None:
    client = parts.client()
    client.post("/cells", json={"id": "a1"})
    assert client.post("/cells", json={"id": "A1"}).status_code == 409
    assert client.post("/cells", json={"like": "C9"}).status_code == client.get("/cells/C9").status_code == 404
    assert client.request("PUT", "/benches/left/cell", json={}).status_code == 422


def test_the_tighter_limits_of_bench_and_cell_hold_and_the_cells_capacity_counts(parts: Parts) -> None:
    client, left = parts.client(), parts.benches["left"]
    client.post("/cells", json={"type": TYPE})
    answer = client.request("PUT", "/benches/left/cell", json={"cell_id": "c1"})
    assert answer.status_code == 200
    told = answer.json()
    assert (told["cell"]["id"], told["cell"]["type"], told["capacity_Ah"]) == ("C1", "Maker M50", 5.0)
    assert told["limits"]["voltage_V"] == [2.5, 4.1] and told["limits"]["current_A"] == [-7.5, 4.0]
    assert told["limits"]["temperature_degC"] == [0.0, 45.0]
    assert cast(Any, left.supervisor).told["limits"].current_A == (-7.5, 4.0)
    cell = client.get("/cells/C1").json()
    assert cell["bench"] == "left" and cell["places"][0]["bench"] == "left"
    assert client.request("PUT", "/benches/right/cell", json={"cell_id": "C1"}).status_code == 409
    assert client.post("/cells/C1/retire").status_code == 409
    client.request("PATCH", "/cells/C1", json={"type": TYPE | {"charge_A": 2.5}, "capacity_Ah": 4.5})
    assert (left.limits.current_A, left.config.capacity_Ah) == ((-7.5, 2.5), 4.5)
    off = client.request("PUT", "/benches/left/cell", json={"cell_id": None}).json()
    assert (off["cell"], off["capacity_Ah"], off["limits"]["current_A"]) == (None, 2.0, [-10.0, 5.0])
    assert [text for text, _ in parts.journal.noted[-2:]][-1] == "cell C1 is taken off bench 'left'"


def test_nothing_is_put_on_a_bench_that_is_busy_or_cannot_bear_it(parts: Parts) -> None:
    client = parts.client()
    client.post("/cells", json={"type": TYPE | {"voltage_V": [4.3, 8.4]}})
    answer = client.request("PUT", "/benches/left/cell", json={"cell_id": "C1"})
    assert answer.status_code == 422 and "limits.voltage_V of bench and cell have nothing in common" in answer.text
    client.post("/cells", json={"type": TYPE})
    parts.busy = "left"
    assert client.request("PUT", "/benches/left/cell", json={"cell_id": "C2"}).status_code == 409
    assert parts.store.cells.place("left") is None and parts.benches["left"].cell is None


def test_a_simulated_cell_holds_what_it_is_simulated_with() -> None:
    cell = CellRecord(id="C1", type=TYPE, created_utc="")
    config = with_cell(bench(real=False).base, cell)
    assert (config.capacity_Ah, config.limits.current_A) == (2.0, (-7.5, 4.0))
    nameless = with_cell(bench().base, CellRecord(id="C1", capacity_Ah=3.0, created_utc=""))
    assert (nameless.capacity_Ah, nameless.limits.current_A) == (3.0, (-10.0, 5.0))


def test_a_chamber_goes_no_further_than_the_cell() -> None:
    chamber = {"url": "modbus-tcp://127.0.0.1:2", "temperature_degC": (-10.0, 60.0)}
    on = bench(chamber=chamber).base
    assert with_cell(on, CellRecord(id="C1", type=TYPE, created_utc="")).chamber_degC == (0.0, 45.0)
    hot = TYPE | {"temperature_degC": [60.0, 80.0]}
    with pytest.raises(BadRequestError, match="temperature_degC of bench and cell"):
        with_cell(on, CellRecord(id="C1", type=hot, created_utc=""))


def test_a_run_is_only_played_on_the_cell_that_is_meant(parts: Parts) -> None:
    left = parts.benches["left"]
    cell = parts.store.cells.add()
    check_cell(None, left, parts.store)
    with pytest.raises(ConflictError, match="on bench 'left' there is no cell that is named, not C1"):
        check_cell("C1", left, parts.store)
    begun = RunIntent(bench="left", profile_id=None, dt_s=1.0, initial_soc=0.5, capacity_Ah=2.5, limits={},
                      code_version="1")  # fmt: skip
    before = parts.store.runs.add(begun)
    check_cell(None, left, parts.store, continues=before.id)
    left.carry(cell, "2026-01-01")
    check_cell("c1", left, parts.store)
    with pytest.raises(ConflictError, match="there is cell C1, but it began on a cell that nobody has named"):
        check_cell(None, left, parts.store, continues=before.id)


def test_a_run_is_given_to_a_cell(parts: Parts) -> None:
    parts.store.cells.add()
    intent = RunIntent(bench="import", profile_id=None, dt_s=1.0, initial_soc=0.5, capacity_Ah=2.5, limits={},
                       code_version="1", name="old")  # fmt: skip
    run = parts.store.runs.add(intent)
    client = parts.client()
    assert client.request("PATCH", f"/runs/{run.id}", json={"cell_id": "c1"}).json()["cell_id"] == "C1"
    assert parts.journal.noted == [("run 'old' belongs to cell C1", "C1")]
    both = client.request("PATCH", f"/runs/{run.id}", json={"cell_id": None, "label": "x"}).json()
    assert (both["cell_id"], both["label"]) == (None, "x")
    assert client.request("PATCH", f"/runs/{run.id}", json={"cell_id": "C9"}).status_code == 404
