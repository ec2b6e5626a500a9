"""Whole campaigns on the real service: what they leave behind, where they start, and what a restart makes of them."""

import itertools
import os
import signal
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from control_rig import Simulator
from service_rig import Service, hardware, until

from bench_service.client import ClientError
from tests.patience import LONG_S, PATIENCE_S

pytestmark = pytest.mark.timeout(3 * LONG_S)
SIMULATED = "[bench.sim]\nsimulate = { seed = 3 }\n"
# Short because it stays in the middle of the range.
SHORT = {"bench": "sim", "name": "short", "duration_s": 2000.0, "soc": [0.45, 0.55], "structure": "minimal", "seed": 4}
WINDOW = {"duration_s": 4200.0, "soc": [0.4, 0.6]}


@dataclass
class House:
    """A service that a test may replace by the next one on the same data."""

    directory: Path
    service: Service

    def restart(self) -> None:
        self.service = Service(self.directory, SIMULATED)


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    directory = tmp_path_factory.mktemp("campaign")
    house = House(directory, Service(directory, SIMULATED))
    yield house
    assert house.service.end() == (0, "")


@pytest.fixture
def service(house: House) -> Service:
    return house.service


@pytest.fixture(scope="module")
def completed(house: House) -> dict[str, Any]:
    """A campaign that has gone through; started at once, while the bench is still being connected."""
    client = house.service.client
    campaign = client.start_campaign(SHORT)
    ended = client.wait_campaign(campaign["id"], timeout_s=LONG_S)
    assert ended["state"] == "completed", ended["message"]
    return ended


def refusal(service: Service, body: dict[str, Any]) -> tuple[int, dict[str, Any]]:
    answer = httpx.post(f"{service.url}/api/v1/campaigns", json=body, timeout=PATIENCE_S)
    error = answer.json()["error"]
    assert set(error) == {"code", "message", "where"}
    return answer.status_code, error


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def events_of(service: Service, campaign: dict[str, Any]) -> list[dict[str, Any]]:
    """Events of a campaign, oldest first."""
    return [event for event in reversed(service.client.events(limit=500)) if event["campaign_id"] == campaign["id"]]


def counted_end(service: Service, run_id: str) -> float:
    """SoC at the end of a run by a sum of the test's own."""
    run, columns = service.client.run(run_id), service.client.samples(run_id)["columns"]
    steps = zip(columns["current_A"][1:], itertools.pairwise(columns["time_s"]), strict=True)
    moved_As = sum(current_A * (end_s - start_s) for current_A, (start_s, end_s) in steps)
    return run["initial_soc"] + moved_As / 3600 / run["capacity_Ah"]


def test_events_tell_the_story(service: Service, completed: dict[str, Any]) -> None:
    train, validate = (run["run_id"] for run in completed["result"]["runs"])
    told = [(event["code"], event["severity"], event["run_id"]) for event in events_of(service, completed)]
    assert told == [
        ("campaign_started", "info", None),
        ("run_started", "info", train),
        ("run_completed", "info", train),
        ("run_started", "info", validate),
        ("run_completed", "info", validate),
        ("campaign_completed", "info", None),
    ]
    texts = [event["text"] for event in events_of(service, completed)]
    assert "'short'" in texts[0] and "from 50.0% as the configuration has it" in texts[0]
    n_samples = completed["result"]["runs"][0]["n_samples"]
    assert f"'short: train' ended as completed; {n_samples} samples stored" in texts[2]
    assert {event["bench"] for event in events_of(service, completed)} == {"sim"}


def test_the_observer_is_judged_in_the_report(completed: dict[str, Any]) -> None:
    soc = completed["result"]["soc"]
    assert soc["started_off_by"] == 0.2 and 0 < soc["rmse"] <= soc["max_error"] <= 0.2
    assert [stage["state"] for stage in completed["stages"]] == ["done"] * 6


def test_the_curves_behind_a_comparison(service: Service, completed: dict[str, Any]) -> None:
    result = completed["result"]
    whole = service.client.comparison_series(result["comparison_id"], max_points=20_000)[0]
    assert set(whole) == {"run_id", "time_s", "measured_V", "model_V", "residual_mV"}
    assert whole["run_id"] == result["runs"][1]["run_id"]
    samples = service.client.samples(whole["run_id"])["columns"]
    assert whole["time_s"] == samples["time_s"] and whole["measured_V"] == samples["voltage_V"]
    residual_mV = np.array(whole["residual_mV"])
    np.testing.assert_allclose(residual_mV, 1e3 * (np.array(whole["measured_V"]) - whole["model_V"]), atol=1e-9)
    assert np.sqrt(np.mean(residual_mV**2)) == pytest.approx(result["validation"]["rmse_mV"], rel=1e-9)

    thin = service.client.comparison_series(result["comparison_id"], max_points=200)[0]
    assert len(thin["time_s"]) <= 200 and len({len(values) for values in thin.values()} - {len(thin["run_id"])}) == 1
    assert (thin["time_s"][0], thin["time_s"][-1]) == (whole["time_s"][0], whole["time_s"][-1])
    for name in ("measured_V", "model_V", "residual_mV"):
        assert (min(thin[name]), max(thin[name])) == (min(whole[name]), max(whole[name]))
    assert len(service.client.comparison_series(result["comparison_id"])[0]["time_s"]) <= 2000


def test_curves_that_are_not_there_or_not_wanted_so(service: Service, completed: dict[str, Any]) -> None:
    address = f"{service.url}/api/v1/comparisons"
    assert httpx.get(f"{address}/none/series").status_code == 404
    for points in ("1", "20001", "x", "2.5"):
        answer = httpx.get(f"{address}/{completed['result']['comparison_id']}/series?max_points={points}")
        assert answer.status_code == 422 and answer.json()["error"]["where"] == ["max_points"]


def test_what_a_campaign_may_not_ask_is_said_before_it_starts(service: Service, completed: dict[str, Any]) -> None:
    before = len(service.client.campaigns())
    for changes, where in (
        ({"current_A": [-11.0, 2.0]}, ["current_A"]),
        ({"soc": [0.8, 0.9], "initial_soc": 0.5}, ["initial_soc"]),
        ({"duration_s": 1e12}, ["duration_s"]),
        ({"dt_s": 60.0}, ["dt_s"]),
        ({"initial_soc": None, "soc": [0.9, 0.1]}, ["soc"]),
    ):
        status, error = refusal(service, SHORT | changes)
        assert (status, error["where"]) == (422, where), error
    status, error = refusal(service, SHORT | {"duration_s": 1100.0})
    assert (status, error["where"]) == (422, None) and "do not suffice" in error["message"]
    assert refusal(service, SHORT | {"bench": "none"})[0] == 404
    assert len(service.client.campaigns()) == before


def test_the_next_campaign_starts_where_the_last_run_ended(service: Service, completed: dict[str, Any]) -> None:
    service.idle("sim")
    campaign = service.client.start_campaign(SHORT | {"name": "next"})
    status, error = refusal(service, SHORT)
    assert (status, error["code"]) == (409, "bench_busy")
    try:
        last = completed["result"]["runs"][1]["run_id"]
        assert campaign["request"]["initial_soc"] == pytest.approx(counted_end(service, last), abs=1e-9)
        assert campaign["request"]["initial_soc"] != 0.5
        assert campaign["request"]["initial_soc_from"] == f"the end of run {last}"
    finally:
        stopped = service.client.stop_campaign(campaign["id"])
    assert (stopped["state"], stopped["message"]) == ("stopped", "stopped by a client")
    told = until(lambda: (e := events_of(service, campaign)) and e[-1]["code"] == "campaign_stopped" and e, "told")
    assert told[-1]["severity"] == "warning" and "stopped by a client" in told[-1]["text"]


def test_a_bench_with_a_run_takes_no_campaign(service: Service) -> None:
    until(lambda: not service.client.runs(state="running"), "no run")
    service.idle("sim")
    profile = service.client.upload_profile("long", [0, 30_000], [0.05, 0.0])
    run = service.client.start_run("sim", profile["id"], 0.1, 0.5)
    assert refusal(service, SHORT)[0] == 409
    service.client.stop_run(run["id"])
    assert service.client.wait_run(run["id"], timeout_s=PATIENCE_S)["state"] == "stopped"
    ended = until(
        lambda: next((e for e in service.client.events(run["id"]) if e["code"] == "run_stopped"), None), "told"
    )
    assert "stopped by a client" in ended["text"] and ended["severity"] == "warning"


def test_a_second_round_plays_what_was_designed_from_the_first(service: Service) -> None:
    client = service.client
    service.idle("sim")
    ended = client.wait_campaign(client.start_campaign(SHORT | {"rounds": 2})["id"], timeout_s=LONG_S)
    assert ended["state"] == "completed", ended["message"]
    result = ended["result"]
    assert [run["role"] for run in result["runs"]] == ["train", "train_2", "validate"]
    first, second = result["rounds"]
    assert first["design"] is None and second["design"]["pre_test"] is False
    assert second["run_id"] == result["runs"][1]["run_id"] and second["model_id"] == result["model_id"]
    assert [each["validation_rmse_mV"] for each in (first, second)] == [
        each["validation_rmse_mV"] for each in result["model_chain"]
    ]
    assert second["validation_rmse_mV"] == result["validation"]["rmse_mV"]
    assert [run["run_id"] for run in client.model(result["model_id"])["train"]] == [first["run_id"], second["run_id"]]
    # What was played is the design: its current, within the sensor's noise, and its voltage within the band.
    played = client.samples(second["run_id"])["columns"]
    assert len(played["time_s"]) == second["design"]["n_samples"] + 1
    low, high = second["design"]["predicted"]["voltage_with_band_V"]
    assert low - 0.005 < min(played["voltage_V"]) < max(played["voltage_V"]) < high + 0.005
    # The next run begins where this one has left the cell.
    last = client.run(result["runs"][2]["run_id"])
    assert last["initial_soc"] == pytest.approx(counted_end(service, second["run_id"]), abs=1e-9)


def test_a_restart_keeps_what_is_done_and_tells_what_is_not(house: House, completed: dict[str, Any]) -> None:
    done, client = house.service.client.campaign(completed["id"]), house.service.client
    house.service.idle("sim")
    long = {"bench": "sim", "name": "long", "dt_s": 0.1, "duration_s": 100_000.0, "soc": [0.3, 0.7]}
    cut = client.start_campaign(long)
    until(lambda: client.runs(campaign_id=cut["id"], state="running"), "its first run")
    os.kill(house.service.process.pid, signal.SIGKILL)
    house.service.end()

    house.restart()
    service, client = house.service, house.service.client
    assert client.campaign(done["id"]) == done and done["result"]["comparison_id"]
    found = client.campaign(cut["id"])
    assert (found["state"], found["stage"]) == ("interrupted", "run") and found["ended_utc"]
    assert [stage["state"] for stage in found["stages"]] == ["done", "interrupted"] + ["waiting"] * 4
    told = until(lambda: (e := events_of(service, cut)) and e[-1]["code"] == "campaign_interrupted" and e, "told")
    assert told[0]["code"] == "campaign_started" and "in stage 'run'" in told[-1]["text"]
    # The simulated cell is a new one: what the old one went through says nothing about it.
    until(lambda: client.bench("sim")["state"] == "fault", "latched")
    status, error = refusal(service, SHORT)
    assert (status, error["code"]) == (409, "bench_busy") and "acknowledge" in error["message"]
    until(lambda: client.acknowledge("sim")["state"] == "idle", "acknowledged")
    again = client.start_campaign(SHORT)
    assert (again["request"]["initial_soc"], again["request"]["initial_soc_from"]) == (0.5, "the configuration")
    assert client.stop_campaign(again["id"])["state"] == "stopped"


def test_a_campaign_waits_for_a_bench_that_comes_up(tmp_path: Path) -> None:
    port = free_port()
    service = Service(tmp_path, hardware("cell", f"modbus-tcp://127.0.0.1:{port}"))
    try:
        with pytest.raises(ClientError, match="give initial_soc") as refused:
            service.client.start_campaign({"bench": "cell"})
        assert refused.value.status == 422 and refused.value.where == ["initial_soc"]
        campaign = service.client.start_campaign({"bench": "cell", "initial_soc": 0.5} | WINDOW)
        waiting = until(
            lambda: (c := service.client.campaign(campaign["id"]))["message"].startswith("waiting") and c, "waiting"
        )
        assert waiting["state"] == "running" and waiting["stage"] == "run"
        simulator = Simulator(lock_step=False, port=port)
        try:
            until(lambda: service.client.runs(campaign_id=campaign["id"], state="running"), "its first run")
            assert service.client.stop_campaign(campaign["id"])["state"] == "stopped"
            until(lambda: service.client.runs(campaign_id=campaign["id"], state="stopped"), "its run stopped")
        finally:
            service.end()
            simulator.end()
    finally:
        service.end()


def test_a_real_cell_stands_where_its_last_complete_run_has_left_it(tmp_path: Path) -> None:
    simulator = Simulator(lock_step=True)
    service = Service(tmp_path, hardware("cell", simulator.url))
    try:
        service.idle("cell")
        profile = service.client.upload_profile("down", [0, 360], [-1.25, 0.0])
        run = service.client.start_run("cell", profile["id"], 1.0, 0.55)
        assert service.client.wait_run(run["id"], timeout_s=PATIENCE_S)["state"] == "completed"
        campaign = service.client.start_campaign({"bench": "cell"} | WINDOW)
        assert campaign["request"]["initial_soc"] == pytest.approx(0.5, abs=1e-3)
        begun = until(lambda: service.client.runs(campaign_id=campaign["id"], state="running"), "its run")
        live = until(
            lambda: (v := service.client.bench("cell")["live"]) and v["run_id"] == begun[0]["id"] and v, "live values"
        )
        assert live["seq"] >= 0
        service.client.stop_campaign(campaign["id"])
        cut = until(lambda: service.client.runs(campaign_id=campaign["id"], state="stopped"), "its run stopped")
        assert cut[0]["n_samples"] > 0
        with pytest.raises(ClientError, match="give initial_soc"):
            service.client.start_campaign({"bench": "cell"} | WINDOW)
    finally:
        service.end()
        simulator.end()
