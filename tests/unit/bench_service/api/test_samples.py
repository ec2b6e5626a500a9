"""Samples over REST: as columns, thinned, or as a file."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench_service.api import samples
from bench_service.errors import NotFoundError
from bench_service.exchange.write import export_formats
from bench_service.store.reading import Gap, StreamData
from bench_service.store.views import Views
from bench_service.streams import OBSERVER, SAMPLES, STREAMS, content_hash
from tests.unit.bench_service.api.route_rig import Part, Store, client_of, error_of, run_record


def stream(n: int, name: str = SAMPLES, **columns: Any) -> StreamData:
    """Rows from sequence number 5 on, a second apart."""
    layout = STREAMS[name]
    values = {column.name: np.zeros(n, column.numpy) for column in layout}
    values["time_s"] = np.arange(n, dtype=np.float64)
    return StreamData(layout, values | columns, np.arange(5, 5 + n), ())


def rig(data: StreamData, **run: Any) -> tuple[Any, Part]:
    store = Store(runs={"get": run_record(**run)})
    reader = Part(read=data, n_rows=data.n)
    storage = Part(note_damage=None)
    parts = {"store": store, "samples": reader, "views": Views(reader), "storage": storage}  # type: ignore[arg-type]
    parts |= {"config": SimpleNamespace(institution="lab"), "version": "1"}
    return client_of(samples.router, **parts), reader


def test_all_columns_with_their_sequence_numbers() -> None:
    client, reader = rig(stream(3, voltage_V=np.array([3.5, 3.6, 3.7])))
    answer = client.get("/runs/r1/samples?from_s=0.5&to_s=2")
    document = answer.json()
    assert answer.headers["content-type"] == "application/json"
    assert list(document["columns"]) == ["seq", *(column.name for column in STREAMS[SAMPLES])]
    assert document["columns"]["seq"] == [5, 6, 7] and document["columns"]["voltage_V"] == [3.5, 3.6, 3.7]
    assert (document["n"], document["decimated"]) == (3, False)
    assert reader.calls == [("read", ("r1", SAMPLES, 0.5, 2.0), {})]


def test_a_missing_value_is_null_and_never_nan() -> None:
    client, _ = rig(stream(3, voltage_V=np.array([3.5, np.nan, np.inf])))
    text = client.get("/runs/r1/samples").text
    assert "NaN" not in text and "Infinity" not in text
    assert json.loads(text)["columns"]["voltage_V"] == [3.5, None, None]


def test_a_run_without_samples_has_no_columns() -> None:
    client, _ = rig(StreamData.empty())
    assert client.get("/runs/r1/samples").json() == {"columns": {}, "n": 0, "decimated": False}


def test_thinned_samples_keep_their_extremes_and_their_rows_whole() -> None:
    voltage_V = np.full(1000, 3.6)
    voltage_V[[123, 777]] = 3.9, 3.1
    client, _ = rig(stream(1000, voltage_V=voltage_V))
    document = client.get("/runs/r1/samples?max_points=50").json()
    assert document["decimated"] and document["n"] == len(document["columns"]["seq"]) <= 50
    kept = dict(zip(document["columns"]["seq"], document["columns"]["voltage_V"], strict=True))
    assert (kept[5 + 123], kept[5 + 777]) == (3.9, 3.1)
    assert {5, 5 + 999} <= set(kept)


def test_a_long_run_is_one_json_document_however_many_parts_it_comes_in() -> None:
    n = 45_000
    client, _ = rig(stream(n))
    document = client.get("/runs/r1/samples").json()
    assert document["n"] == n and document["columns"]["time_s"] == list(map(float, range(n)))


def test_the_observer_has_a_stream_of_its_own_shaped_by_soc_and_innovation() -> None:
    soc = np.full(500, 0.5)
    soc[321] = 0.9
    client, reader = rig(stream(500, OBSERVER, soc=soc))
    document = client.get("/runs/r1/observer?max_points=20").json()
    assert 0.9 in document["columns"]["soc"]
    assert reader.calls[0][1][1] == OBSERVER


@pytest.mark.parametrize("query", ["max_points=1", "max_points=1000001", "from_s=nan", "to_s=inf", "from_s=x"])
def test_a_query_that_is_none_is_refused(query: str) -> None:
    client, reader = rig(stream(3))
    assert client.get(f"/runs/r1/samples?{query}").status_code == 422
    assert reader.calls == []


def test_an_interval_that_ends_before_it_begins_is_refused() -> None:
    client, reader = rig(stream(3))
    answer = client.get("/runs/r1/samples?from_s=2&to_s=1")
    assert (answer.status_code, error_of(answer)["where"]) == (422, ["from_s"])
    assert reader.calls == []
    assert client.get("/runs/r1/samples?from_s=1&to_s=1").status_code == 200


def test_a_run_that_is_not_there_is_404_and_not_empty() -> None:
    store = Store(runs={"get": NotFoundError.of("run", "r9")})
    client = client_of(samples.router, store=store, samples=Part())
    for address in ("samples", "observer", "export"):
        assert client.get(f"/runs/r9/{address}").status_code == 404


def test_every_format_that_can_be_written_is_a_download_of_its_type() -> None:
    client, _ = rig(stream(3))
    for name, each in export_formats().items():
        answer = client.get(f"/runs/r1/export?format={name}")
        assert answer.status_code == 200 and answer.content
        assert answer.headers["content-type"].split(";")[0] == each.media_type.split(";")[0]
        assert answer.headers["content-disposition"] == f'attachment; filename="run-r1{each.suffix}"'


def test_bdf_is_the_format_where_none_is_named() -> None:
    client, _ = rig(stream(3))
    assert client.get("/runs/r1/export").content == client.get("/runs/r1/export?format=bdf").content
    assert b"Test Time / s" in client.get("/runs/r1/export").content


def test_a_run_that_never_started_has_no_clock_time() -> None:
    client, _ = rig(stream(3), started_utc=None)
    assert client.get("/runs/r1/export").status_code == 200
    assert b"Unix Time" not in client.get("/runs/r1/export").content


def test_an_unknown_format_and_an_empty_run_are_refused() -> None:
    client, _ = rig(stream(3))
    answer = client.get("/runs/r1/export?format=xls")
    assert (answer.status_code, error_of(answer)["code"]) == (422, "bad_file")
    empty, _ = rig(StreamData.empty())
    assert empty.get("/runs/r1/export").status_code == 409


def damaged_stream() -> StreamData:
    """Rows 5, 6 and 7, of 0 to 9."""
    whole = stream(3)
    return StreamData(whole.layout, whole.columns, whole.seq, (Gap(0, 5, "missing"), Gap(8, 2, "chunk 4: checksum")))


@pytest.mark.parametrize("address", ["samples", "observer", "export", "samples?from_s=1", "samples?max_points=2"])
def test_what_cannot_be_read_is_told_by_the_status_and_refused(address: str) -> None:
    client, _ = rig(damaged_stream(), n_samples=10)
    answer = client.get(f"/runs/r1/{address}")
    assert (answer.status_code, error_of(answer)["code"]) == (409, "damaged")
    assert "7 of 10 samples cannot be read (rows 0 to 4: missing; rows 8 to 9: chunk 4" in error_of(answer)["message"]
    assert "damaged=include" in error_of(answer)["message"]


def test_what_is_left_of_a_damaged_run_is_given_to_who_asks_for_it_with_what_is_missing() -> None:
    client, _ = rig(damaged_stream(), n_samples=10)
    answer = client.get("/runs/r1/samples?damaged=include")
    document = answer.json()
    assert answer.status_code == 206 and document["n"] == 3
    assert document["gaps"] == [
        {"seq": 0, "n": 5, "reason": "missing"},
        {"seq": 8, "n": 2, "reason": "chunk 4: checksum"},
    ]
    assert document["damage"].startswith("7 of 10 samples")
    exported = client.get("/runs/r1/export?damaged=include")
    assert exported.status_code == 206 and "run-r1-damaged.bdf.csv" in exported.headers["content-disposition"]


@pytest.mark.parametrize("address", ["samples", "observer", "export", "samples?to_s=1"])
def test_a_run_that_claims_more_than_is_stored_is_refused(address: str) -> None:
    """As from a file of samples that was emptied: it reads well, and there is nothing in it."""
    client, _ = rig(stream(3) if "?" in address else StreamData.empty(), n_samples=100)
    answer = client.get(f"/runs/r1/{address}")
    assert (answer.status_code, error_of(answer)["code"]) == (409, "damaged")
    assert "of 100 samples are stored" in error_of(answer)["message"]


def test_samples_that_are_not_those_that_were_recorded_are_refused() -> None:
    client, _ = rig(stream(3), n_samples=3, sha256="0" * 64)
    assert "their hash is another" in error_of(client.get("/runs/r1/samples"))["message"]
    whole = stream(3)
    client, _ = rig(whole, n_samples=3, sha256=content_hash(whole.columns))
    assert client.get("/runs/r1/samples").status_code == 200


def test_a_run_that_goes_on_has_as_many_samples_as_it_has() -> None:
    client, _ = rig(stream(3), state="running")
    assert client.get("/runs/r1/samples").status_code == 200


def test_columns_that_are_counted_come_where_they_are_asked_for() -> None:
    client, _ = rig(stream(4, current_A=np.full(4, 3.6), voltage_V=np.full(4, 2.0)))
    document = client.get("/runs/r1/samples?columns=time_s,charge_Ah, energy_Wh").json()
    assert document["columns"]["charge_Ah"] == pytest.approx([0.0, 1e-3, 2e-3, 3e-3])
    assert document["columns"]["energy_Wh"] == pytest.approx([0.0, 2e-3, 4e-3, 6e-3])
    assert list(document["columns"]) == ["time_s", "charge_Ah", "energy_Wh"]
    answer = client.get("/runs/r1/samples?columns=time_s,joy")
    assert (answer.status_code, error_of(answer)["where"]) == (422, ["columns"])
    assert "no column 'joy'; there are ambient_degC, charge_Ah" in error_of(answer)["message"]


def test_only_what_is_new_is_sent() -> None:
    client, _ = rig(stream(4), state="running")
    document = client.get("/runs/r1/samples?after_seq=6&points=50").json()
    assert document["columns"]["seq"] == [7, 8] and not document["decimated"]
    assert client.get("/runs/r1/samples?after_seq=8").json()["columns"] == {}


def test_points_and_their_older_name_give_one_picture() -> None:
    client, _ = rig(stream(900, voltage_V=np.sin(np.arange(900.0))))
    one, other = (client.get(f"/runs/r1/samples?{name}=90").json() for name in ("points", "max_points"))
    assert one == other and one["decimated"] and one["n"] <= 90


def test_who_takes_gzip_gets_it() -> None:
    client, _ = rig(stream(5000))
    packed = client.get("/runs/r1/samples")
    plain = client.get("/runs/r1/samples", headers={"Accept-Encoding": "identity"})
    assert packed.headers["content-encoding"] == "gzip" and "content-encoding" not in plain.headers
    assert packed.json() == plain.json()


def test_incremental_capacity_of_a_part() -> None:
    n = 3601
    current_A = np.where(np.arange(n) < 1801, 1.0, -1.0)
    voltage_V = 3.0 + np.concatenate([[0.0], np.cumsum(current_A[1:])]) / 3600.0
    client, _ = rig(stream(n, current_A=current_A, voltage_V=voltage_V))
    document = client.get("/runs/r1/incremental?step_mV=50").json()
    assert set(document) == {"charge", "discharge"}
    # One volt an ampere-hour, both ways round.
    assert document["charge"]["dQ_dV_Ah_per_V"][1:-1] == pytest.approx([1.0] * 8, rel=0.01)
    assert document["discharge"]["dV_dQ_V_per_Ah"] == pytest.approx([1.0] * len(document["discharge"]["charge_Ah"]))
    assert set(client.get("/runs/r1/incremental?to_s=1000").json()) == {"charge"}
    assert client.get("/runs/r1/incremental?from_s=9e9").json() == {}
    assert client.get("/runs/r1/incremental?step_mV=0").status_code == 422
