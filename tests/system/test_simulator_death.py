"""The simulator of a bench dies in the middle of a run: the run says why it ended, and the bench comes back."""

import os
import signal
from pathlib import Path
from typing import Any

from service_rig import Service, until
from test_service_death import children, command_of

BENCH = "[bench.sim]\nsimulate = { seed = 3, lock_step = false }\n"


def simulators(service: Service) -> list[int]:
    """Process ids of the simulators themselves, below their guards."""
    guards = [pid for pid in children(service.process.pid) if "bench_service.simulation" in command_of(pid)]
    return [each for guard in guards for each in children(guard)]


def run_with(service: Service) -> dict[str, Any]:
    profile = service.client.upload_profile("steady", [0, 600], [1.0, 0.0])
    run = service.client.start_run("sim", profile["id"], 0.1, 0.5)
    until(lambda: ((service.client.bench("sim")["live"] or {}).get("time_s") or 0) > 1.0, "run in progress")
    return run


def test_a_killed_simulator_ends_the_run_and_is_started_again(tmp_path: Path) -> None:
    service = Service(tmp_path, BENCH)
    try:
        service.idle("sim")
        url, run = service.client.bench("sim")["url"], run_with(service)
        (killed,) = simulators(service)
        os.kill(killed, signal.SIGKILL)
        ended = service.client.wait_run(run["id"], timeout_s=20.0)
        assert ended["state"] == "fault" and "cycler" in ended["reason"]
        assert ended["n_samples"] == service.client.samples(run["id"])["n"] > 5
        bench = until(lambda: (b := service.client.bench("sim"))["state"] == "fault" and b, "latched")
        assert run["id"] in bench["reason"] or "cycler" in bench["reason"]
        until(lambda: simulators(service) not in ([], [killed]), "a simulator again")
        until(lambda: service.client.acknowledge("sim")["state"] == "idle", "acknowledged and back")
        assert service.client.bench("sim")["url"] == url
        told = [event["text"] for event in service.client.events() if event["code"] == "simulator"]
        assert any("ended by itself" in text for text in told) and any(
            "where the last run has" in text for text in told
        )
        again = run_with(service)
        service.client.stop_bench("sim")
        assert service.client.wait_run(again["id"], timeout_s=20.0)["state"] == "stopped"
    finally:
        assert service.end()[0] == 0
