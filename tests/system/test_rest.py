"""The REST interface against a real service with a real recorder, control process and simulator."""

import json
import socket
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from rest_rig import RUN, SIMULATED, Rest, error_of
from service_rig import Service, until
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from bench_service.client import ClientError
from tests.patience import LONG_S, PATIENCE_S


@pytest.fixture(scope="module")
def finished(rest: Rest) -> dict[str, Any]:
    rest.service.idle("sim")
    run = rest.client.start_run("sim", rest.profile_id, 0.1, 0.5, name="first", seed=7)
    return rest.client.wait_run(run["id"], timeout_s=PATIENCE_S)


def test_health_names_every_process(rest: Rest) -> None:
    health = rest.client.health()
    assert health["status"] == "ok" and health["recorder"] == "running" and set(health["benches"]) == {"sim"}


def test_a_bench_shows_what_it_is(rest: Rest) -> None:
    bench = until(lambda: (b := rest.client.bench("sim"))["live"] and b, "live values")
    assert bench["lock_step"] is True and bench["limits"]["voltage_V"] == [2.5, 4.2]
    assert bench["capabilities"]["name"] and bench["url"].startswith("modbus-tcp://127.0.0.1:")
    assert rest.client.benches()[0]["name"] == "sim"


def test_a_profile_comes_back_as_it_was(rest: Rest) -> None:
    sent = ([0.0, 0.1, 0.30000000000000004], [1 / 3, -1e-17, 0.0])
    stored = rest.client.upload_profile("exact", *sent)
    found = rest.client.profile(stored["id"], points=True)
    assert (found["time_s"], found["current_A"]) == sent
    assert stored["id"] in [profile["id"] for profile in rest.client.profiles()]


def test_a_profile_may_be_csv(rest: Rest) -> None:
    csv = "time_s,current_A\n0,1.5\n10,0\n"
    answer = rest.post("/profiles?name=table", csv, **{"content-type": "text/csv; charset=utf-8"})
    assert answer.status_code == 201 and answer.json()["current_A"] == [0.0, 1.5]


@pytest.mark.parametrize(
    ("csv", "message"),
    [
        (b"time_s,amps\n0,1\n1,0\n", "wrong columns"),
        (b"time_s,current_A\n0,1\n1,nan\n", "missing"),
        (b"time_s,current_A\n0,1\n1,1e999\n", "infinite"),
        (b"\x1f\x8b\x08\x00", "compressed"),
        (b"", "empty"),
    ],
)
def test_a_bad_csv_is_refused_without_naming_files(rest: Rest, csv: bytes, message: str) -> None:
    answer = rest.post("/profiles?name=x", csv, **{"content-type": "text/csv"})
    assert answer.status_code == 422
    assert message in error_of(answer)["message"] and "/tmp" not in answer.text


def test_a_run_is_played_and_stored(rest: Rest, finished: dict[str, Any]) -> None:
    assert finished["state"] == "completed" and finished["n_samples"] == 601 and finished["missed_ticks"] == 0
    assert finished["name"] == "first" and finished["seed"] == 7 and finished["sha256"]
    columns = rest.client.samples(finished["id"])["columns"]
    assert columns["seq"] == list(range(601))
    setpoint_A = np.array(columns["setpoint_A"])
    assert (setpoint_A.max(), setpoint_A.min(), columns["current_A"][0]) == (2.0, -2.0, pytest.approx(0, abs=0.01))
    assert finished["id"] in [run["id"] for run in rest.client.runs(bench="sim", state="completed")]
    assert rest.client.runs(bench="other") == []


def test_samples_of_a_range_and_thinned(rest: Rest, finished: dict[str, Any]) -> None:
    part = rest.client.samples(finished["id"], from_s=10.0, to_s=20.0)
    assert part["n"] == 101 and part["decimated"] is False and part["columns"]["time_s"][0] == 10.0
    thin = rest.client.samples(finished["id"], max_points=50)
    whole = rest.client.samples(finished["id"])["columns"]["voltage_V"]
    assert thin["decimated"] is True and thin["n"] == len(thin["columns"]["voltage_V"]) <= 50
    assert max(thin["columns"]["voltage_V"]) == max(whole) and min(thin["columns"]["voltage_V"]) == min(whole)
    assert rest.client.samples(finished["id"], stream="observer") == {"columns": {}, "n": 0, "decimated": False}
    new = rest.client.samples(finished["id"], after_seq=590, columns=["seq", "charge_Ah"])["columns"]
    assert new["seq"] == list(range(591, 601)) and len(new["charge_Ah"]) == 10
    assert set(rest.client.incremental(finished["id"])) == {"charge", "discharge"}


def test_what_a_person_says_of_a_run_is_stored_found_and_told(rest: Rest, finished: dict[str, Any]) -> None:
    assert rest.client.describe_run(finished["id"]) == rest.client.run(finished["id"])  # nothing told, nothing changed
    told = rest.client.describe_run(finished["id"], label="Cell 7", notes="cold\nroom")
    assert (told["label"], told["operator"], told["notes"]) == ("Cell 7", None, "cold\nroom")
    assert [run["id"] for run in rest.client.runs(q="cell cold first")] == [finished["id"]]
    texts = [event["text"] for event in rest.client.events(finished["id"]) if event["code"] == "run_described"]
    assert texts == ["run 'first': label 'Cell 7'; notes 'cold room'"]


def test_export_is_a_file(rest: Rest, finished: dict[str, Any]) -> None:
    answer = rest.get(f"/api/v1/runs/{finished['id']}/export?format=bdf")
    assert answer.headers["content-disposition"].startswith("attachment;")
    lines = answer.text.splitlines()
    assert lines[0].startswith("Test Time / s,Current / A,Voltage / V") and len(lines) == 602
    assert rest.get(f"/api/v1/runs/{finished['id']}/export?format=exe").status_code == 422


def test_a_running_run_is_stopped(rest: Rest) -> None:
    rest.service.idle("sim")
    long = rest.client.upload_profile("long", [0, 30_000], [0.05, 0.0])
    run = rest.client.start_run("sim", long["id"], 0.1, 0.5)
    # At once: the control process may not have begun the run when this arrives.
    rest.client.stop_run(run["id"])
    ended = rest.client.wait_run(run["id"], timeout_s=PATIENCE_S)
    assert ended["state"] == "stopped" and ended["n_samples"] < 300_000
    assert rest.client.stop_run(run["id"])["state"] == "stopped"
    assert rest.client.stop_bench("sim")["state"] in ("idle", "stopping")


def test_of_many_clients_one_gets_the_bench(rest: Rest) -> None:
    rest.service.idle("sim")
    before = len(rest.client.runs(limit=1000))
    long = rest.client.upload_profile("long", [0, 30_000], [0.05, 0.0])

    def start(_: int) -> httpx.Response:
        return rest.post("/runs", RUN | {"profile_id": long["id"]})

    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(start, range(8)))
    assert sorted(answer.status_code for answer in answers) == [201] + [409] * 7
    assert {error_of(answer)["code"] for answer in answers if answer.status_code == 409} == {"bench_busy"}
    # Those that lost left nothing behind.
    assert len(rest.client.runs(limit=1000)) == before + 1
    winner = next(answer.json()["id"] for answer in answers if answer.status_code == 201)
    rest.client.stop_run(winner)
    assert rest.client.wait_run(winner, timeout_s=PATIENCE_S)["state"] == "stopped"


def test_live_feed_shows_a_run(rest: Rest) -> None:
    rest.service.idle("sim")
    with connect(rest.service.url.replace("http", "ws") + "/api/v1/live", open_timeout=PATIENCE_S) as feed:
        first = json.loads(feed.recv(PATIENCE_S))
        assert first["type"] == "bench" and first["name"] == "sim" and "limits" not in first
        run = rest.client.start_run("sim", rest.profile_id, 0.1, 0.5)
        states, live = [], []
        while states[-1:] != ["idle"] or not live:
            message = json.loads(feed.recv(20))
            if message["type"] == "bench":
                states.append(message["state"])
            elif message["type"] == "live" and message["run_id"] == run["id"]:
                live.append(message)
    assert states[0] == "running" and live[0]["voltage_V"] > 3 and live[0]["bench"] == "sim"
    rest.client.wait_run(run["id"], timeout_s=PATIENCE_S)


def test_live_feed_of_another_site_is_refused(rest: Rest) -> None:
    address = rest.service.url.replace("http", "ws") + "/api/v1/live"
    with pytest.raises(InvalidStatus) as refusal:
        with connect(address, origin=Origin("http://evil.example"), open_timeout=PATIENCE_S):
            pass
    assert refusal.value.response.status_code == 403


def test_live_feed_has_a_cap_on_readers(rest: Rest) -> None:
    address = rest.service.url.replace("http", "ws") + "/api/v1/live"
    with ExitStack() as readers:
        for _ in range(20):
            readers.enter_context(connect(address, open_timeout=PATIENCE_S)).recv(PATIENCE_S)
        with connect(address, open_timeout=PATIENCE_S) as one_more, pytest.raises(ConnectionClosed) as refusal:
            one_more.recv(PATIENCE_S)
    assert refusal.value.rcvd is not None and refusal.value.rcvd.code == 1013


def test_the_interface_describes_itself(rest: Rest) -> None:
    description = rest.get("/api/v1/openapi.json").json()
    assert {"/healthz", "/api/v1/runs", "/api/v1/profiles", "/api/v1/models"} <= set(description["paths"])
    assert set(description["paths"]["/api/v1/profiles"]["post"]["requestBody"]["content"]) == {
        "application/json",
        "text/csv",
    }


def test_a_model_is_fitted_compared_and_given_out(rest: Rest) -> None:
    rest.service.idle("sim")
    # Levels and pulses over half of the range, enough for the smallest model.
    rng = np.random.default_rng(5)
    time_s = np.arange(0, 7200.0, 60.0)
    current_A = rng.choice([-2.5, -1.0, 0.0, 1.0, 2.5], len(time_s))
    current_A -= current_A.mean()
    profile = rest.client.upload_profile("levels", time_s.tolist(), current_A.tolist())
    run = rest.client.start_run("sim", profile["id"], 1.0, 0.5)
    assert rest.client.wait_run(run["id"], timeout_s=PATIENCE_S)["state"] == "completed"
    model = rest.client.fit("small", [run["id"]], 2.5, structure="minimal", timeout_s=LONG_S)
    assert model["metrics"]["train"]["rmse_mV"] < 50 and model["train"][0]["run_id"] == run["id"]
    compared = rest.client.compare(model["id"], [run["id"]])
    assert compared["result"]["overall"]["rmse_mV"] == pytest.approx(model["metrics"]["train"]["rmse_mV"], rel=0.2)
    assert compared["run_ids"] == [run["id"]] and "baselines" not in compared["result"]
    (circuit,) = rest.client.compare(model["id"], [run["id"]], baselines=["1rc"])["result"]["baselines"]
    assert circuit["name"] == "1rc" and circuit["runs"][0]["run"] == run["id"]
    assert 0.0 < circuit["overall"]["rmse_mV"] < 50.0
    header, first, *more = rest.client.comparison_table(compared["id"]).decode().splitlines()
    assert header == "run,time_s,current_A,temperature_degC,soc,voltage_V,simulated_V,band_V,inside"
    assert run["id"] in first and len(more) > 7000 and first.rsplit(",", 1)[1] in ("0", "1")
    tables = rest.client.model_tables(model["id"])
    assert tables["ocv"]["std_V"] is not None and len(tables["resistance"]["soc"]) == len(tables["ocv"]["soc"])
    assert len(tables["local_models"]) == model["metrics"]["n_local_models"]
    document = rest.client.model_document(model["id"])
    assert rest.client.import_model(document)["sha256"] == model["sha256"]
    assert len(rest.client.models()) == 2


def test_a_campaign_is_started_shown_and_stopped(rest: Rest) -> None:
    rest.service.idle("sim")
    campaign = rest.client.start_campaign({"bench": "sim", "seed": 3})
    assert campaign["state"] == "running"
    with pytest.raises(ClientError) as refusal:
        rest.client.start_campaign({"bench": "sim"})
    assert refusal.value.status == 409
    until(lambda: rest.client.runs(campaign_id=campaign["id"], state="running"), "the campaign's first run")
    assert campaign["id"] in [found["id"] for found in rest.client.campaigns()]
    assert rest.client.stop_campaign(campaign["id"])["state"] == "stopped"
    assert rest.client.wait_campaign(campaign["id"], timeout_s=LONG_S)["ended_utc"]
    run = rest.client.runs(campaign_id=campaign["id"])[0]
    assert rest.client.wait_run(run["id"], timeout_s=PATIENCE_S)["state"] == "stopped"
    for body in ({"bench": "sim", "dt_s": "1"}, {"bench": "sim", "soc": [0, 2]}, {"bench": "sim", "extra": 1}):
        assert rest.post("/campaigns", body).status_code == 422
    assert rest.post("/campaigns", {"bench": "none"}).status_code == 404
    assert rest.get("/api/v1/campaigns/none").status_code == 404


def test_a_fit_that_cannot_be_is_told(rest: Rest, finished: dict[str, Any]) -> None:
    with pytest.raises(ClientError) as refusal:
        rest.client.fit("none", ["none"], 2.5)
    assert refusal.value.status == 404
    with pytest.raises(ClientError) as refusal:
        rest.client.import_model({"kind": "cake"})
    assert refusal.value.status == 422
    same = [finished["id"], finished["id"]]
    assert rest.post("/models", {"name": "m", "train": same, "capacity_Ah": 2.5}).status_code == 422
    assert rest.post("/models", {"name": "m", "train": [], "capacity_Ah": 2.5}).status_code == 422
    body = {"name": "m", "train": [finished["id"]], "capacity_Ah": 2.5, "structure": "huge"}
    assert rest.post("/models", body).status_code == 422


def test_a_port_in_use_and_a_data_directory_in_use_give_one_line(rest: Rest, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(AssertionError) as refusal:
            Service(tmp_path, SIMULATED, port=taken.getsockname()[1])
    assert "(2, 'error: cannot listen on 127.0.0.1:" in str(refusal.value)
    assert str(refusal.value).count("\\n") == 1
    second = tmp_path / "second"
    second.mkdir()
    (second / "data").symlink_to(rest.service.data_dir)
    with pytest.raises(AssertionError, match=rf"\(2, .*{rest.service.url}") as refusal:
        Service(second, SIMULATED)
    assert str(refusal.value).count("\\n") == 1


def test_a_bench_is_commissioned(rest: Rest) -> None:
    rest.service.idle("sim")
    assert rest.client.commission("sim")["state"] == "probed"
    answer = rest.client.commission("sim", confirm=True)
    assert (answer["state"], answer["reason"]) == ("passed", None)
    known = rest.client.commissioning("sim")
    assert (known["state"], known["record"]["id"]) == ("simulated", answer["record"])
    assert known["record"]["sha256"] == answer["sha256"] and known["record"]["identity"]["serial"] == "1"
    said = "commissioning_passed"
    until(lambda: said in [event["code"] for event in rest.client.events(limit=20)], "the event")
    assert rest.client.bench("sim")["commissioning"]["record"] == answer["record"]
    rest.service.idle("sim")
    run = rest.client.start_run("sim", rest.profile_id, 0.1, 0.5)
    assert run["commissioning"]["state"] == "simulated"
    assert "not_commissioned" not in [event["code"] for event in rest.client.events(run["id"])]
    rest.client.wait_run(run["id"], timeout_s=PATIENCE_S)
