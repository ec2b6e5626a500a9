"""Campaigns that are cut off by crashes: they go on from the last stored sample where they have declared it."""

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from service_rig import Service, until
from test_service_death import children, command_of

from tests.patience import LONG_S

pytestmark = pytest.mark.timeout(3 * LONG_S)
SIMULATED = "[bench.sim]\nsimulate = { seed = 3 }\n"
SHORT = {"bench": "sim", "name": "short", "duration_s": 2000.0, "dt_s": 0.5, "soc": [0.45, 0.55], "seed": 4}
# Long enough to be caught in the middle, however fast the machine: what is left of it is played only in part.
LONG = SHORT | {"name": "long", "duration_s": 20_000.0}
DECLARED = SHORT | {"duration_s": 4000.0, "structure": "minimal", "on_interruption": "resume"}


def kill(service: Service, module: str) -> None:
    """Kill a process of the service, by its id."""
    os.kill(next(pid for pid in children(service.process.pid) if module in command_of(pid)), signal.SIGKILL)


def stop(service: Service, module: str) -> None:
    """Stop a process of the service, so that it does nothing more, but is there."""
    os.kill(next(pid for pid in children(service.process.pid) if module in command_of(pid)), signal.SIGSTOP)


def played(service: Service, campaign: dict[str, Any], n_runs: int) -> None:
    """Wait until the newest of so many runs of a campaign has stored some of its samples."""
    client = service.client

    def some() -> bool:
        runs = client.runs(campaign_id=campaign["id"])
        return len(runs) >= n_runs and client.samples(runs[0]["id"], damaged="include", max_points=2)["n"] > 0

    until(some, "some of it is played", LONG_S)


def test_a_campaign_goes_on_after_its_processes_and_its_service_were_killed(tmp_path: Path) -> None:
    service = Service(tmp_path, SIMULATED)
    try:
        service.idle("sim")
        campaign = service.client.start_campaign(DECLARED)
        played(service, campaign, 1)
        kill(service, "bench_service.bench ")
        played(service, campaign, 2)
        os.kill(service.process.pid, signal.SIGKILL)
        service.end()
        service = Service(tmp_path, SIMULATED)
        played(service, campaign, 3)
        kill(service, "bench_service.recorder")
        ended = service.client.wait_campaign(campaign["id"], timeout_s=LONG_S)
        assert ended["state"] == "completed", ended["message"]
        runs = sorted(service.client.runs(campaign_id=campaign["id"]), key=lambda run: run["number"])
        assert [run["state"] for run in runs].count("completed") == 2
        check_parts(service, [run for run in runs if run["name"] == "short: train" and run["n_samples"]])
        assert "campaign_resumed" in {event["code"] for event in service.client.events()}
        assert {each["role"] for each in ended["result"]["runs"]} == {"train", "validate"}
    finally:
        service.end()


def check_parts(service: Service, parts: list[dict[str, Any]]) -> None:
    """Each part goes on where the samples of the one before end, in time and in charge."""
    assert len(parts) >= 2
    length_s = 0.0
    for before, after in zip(parts, [*parts[1:], None], strict=True):
        columns = service.client.samples(before["id"])["columns"]
        length_s += columns["time_s"][-1]
        if after is not None:
            moved_Ah = np.sum(np.diff(columns["time_s"]) * np.array(columns["current_A"][1:])) / 3600.0
            assert after["continues"] == before["id"]
            assert after["initial_soc"] == pytest.approx(before["initial_soc"] + moved_Ah / 2.5, abs=1e-6)
    assert length_s == pytest.approx(DECLARED["duration_s"], abs=0.5)


def test_a_run_whose_end_nobody_stored_is_not_completed(tmp_path: Path) -> None:
    service = Service(tmp_path, SIMULATED)
    try:
        service.idle("sim")
        client = service.client
        profile = client.upload_profile("half a day", [0.0, 20_000.0], [0.1, 0.0])
        run = client.start_run("sim", profile["id"], 0.5, 0.5)
        until(lambda: client.samples(run["id"], damaged="include", max_points=2)["n"], "some of it is stored", LONG_S)
        # It goes on being played, for the bench may be ahead of the recorder; then there is none to store the rest.
        stop(service, "bench_service.recorder")
        until(lambda: client.bench("sim")["state"] == "stopping", "it is played to its end", LONG_S)
        kill(service, "bench_service.recorder")
        ended = client.wait_run(run["id"], timeout_s=LONG_S)
        assert ended["state"] == "fault"
        assert "of 40001 samples are known to be stored; the other samples cannot be stored" in ended["reason"]
        assert 0 < ended["n_samples"] < 40_001
        assert "not_sealed" in {event["code"] for event in client.events()}
        until(lambda: client.acknowledge("sim")["state"] == "idle", "acknowledged", LONG_S)
        assert client.samples(run["id"], damaged="include")["n"] >= ended["n_samples"]
    finally:
        service.end()


def test_one_that_has_not_declared_it_stands_still_until_somebody_says_so(tmp_path: Path) -> None:
    service = Service(tmp_path, SIMULATED)
    try:
        service.idle("sim")
        campaign = service.client.start_campaign(LONG | {"structure": "minimal"})
        played(service, campaign, 1)
        told = service.client.estimate_campaign(LONG)
        assert (told["runs"], told["test_s"]) == (2, 2 * LONG["duration_s"])
        waits = service.client.start_campaign(SHORT | {"name": "next", "queue": True, "initial_soc": 0.5})
        assert waits["state"] == "queued"
        kill(service, "bench_service.bench ")
        failed = service.client.wait_campaign(campaign["id"], timeout_s=LONG_S)
        assert (failed["state"], failed["stage"]) == ("failed", "run") and "interrupted" in failed["message"]
        # What waits behind it waits on, over a restart of the service too.
        queue = until(lambda: (q := service.client.queue("sim"))["held"] and q, "the queue waits")
        assert [each["name"] for each in queue["waiting"]] == ["next"] and "'long' ended as failed" in queue["held"]
        resumed = service.client.resume_campaign(campaign["id"])
        assert resumed["state"] == "running"
        played(service, campaign, 2)
        assert any(each["continues"] for each in service.client.runs(campaign_id=campaign["id"]))
        assert service.client.stop_campaign(campaign["id"])["state"] == "stopped"
        assert service.client.campaign(waits["id"])["state"] == "queued"
        service.client.start_queue("sim")
        until(lambda: service.client.campaign(waits["id"])["state"] == "running", "somebody lets the queue go on")
        assert service.client.stop_campaign(waits["id"])["state"] == "stopped"
        assert service.client.campaign(campaign["id"])["state"] == "stopped"
    finally:
        service.end()
