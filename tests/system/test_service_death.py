"""What is left when a part of the service dies in the middle of a run: output off, samples stored, nothing resumed."""

import asyncio
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from control_rig import Simulator
from service_rig import Service, hardware, until

from drivers.cycler import Reading
from drivers.factory import open_cycler
from tests.patience import PATIENCE_S, stretched

SAFE_WITHIN_S = 2.0
DT_S = 0.05


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    simulator = Simulator(lock_step=False)
    yield simulator
    simulator.end()


async def reading(url: str) -> Reading:
    """Read the cycler over a connection of the test's own."""
    cycler = open_cycler(url, "generic", 0.5)
    await cycler.connect()
    try:
        return await cycler.sample()
    finally:
        await cycler.close()


def output_on(simulator: Simulator) -> bool:
    return asyncio.run(reading(simulator.url)).output_on


def start(service: Service, past_s: float = 2.0) -> dict[str, Any]:
    """Start a run and wait until it is some way in."""
    service.idle("cell")
    profile = service.client.upload_profile("steady", [0, 600], [1.0, 0.0])
    run = service.client.start_run("cell", profile["id"], DT_S, 0.5)
    until(lambda: (live_s(service) or 0) > past_s, "run in progress")
    return run


def latched(service: Service) -> str:
    """Wait until the bench is in fault; return why it is."""
    return until(lambda: (b := service.client.bench("cell"))["state"] == "fault" and b, "latched")["reason"]


def live_s(service: Service) -> float | None:
    live = service.client.bench("cell")["live"]
    return None if live is None else live["time_s"]


def children(pid: int) -> list[int]:
    lists = Path(f"/proc/{pid}/task").glob("*/children")  # each thread has its own
    return [int(child) for each in lists for child in each.read_text().split()]


def command_of(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()


def test_killed_service_leaves_rest_and_every_sample(simulator: Simulator, tmp_path: Path) -> None:
    service = Service(tmp_path, hardware("cell", simulator.url))
    run = start(service)
    assert output_on(simulator)
    offspring = children(service.process.pid)
    seen_s = live_s(service) or 0.0

    os.kill(service.process.pid, signal.SIGKILL)
    killed_at_s = time.monotonic()
    until(lambda: not output_on(simulator), "output off")
    assert time.monotonic() - killed_at_s < stretched(SAFE_WITHIN_S)
    service.end()
    until(lambda: not [pid for pid in offspring if Path(f"/proc/{pid}").exists()], "control and recorder ended")

    service = Service(tmp_path, hardware("cell", simulator.url))
    try:
        found = service.client.run(run["id"])
        assert found["state"] == "interrupted" and found["reason"] and found["ended_utc"]
        columns = service.client.samples(run["id"])["columns"]
        assert columns["time_s"][-1] > seen_s - 1.0
        assert columns["seq"] == list(range(found["n_samples"]))
        # Nothing goes on by itself: a person looks first.
        assert run["id"] in latched(service) and not output_on(simulator)
        until(lambda: service.client.acknowledge("cell")["state"] == "idle", "acknowledged")
    finally:
        assert service.end() == (0, "")


def test_a_service_that_is_told_to_end_stops_its_run(simulator: Simulator, tmp_path: Path) -> None:
    service = Service(tmp_path, hardware("cell", simulator.url))
    run = start(service, past_s=0.5)
    assert service.end(signal.SIGTERM) == (0, "")
    assert not output_on(simulator)
    service = Service(tmp_path, hardware("cell", simulator.url))
    try:
        found = service.client.run(run["id"])
        assert (found["state"], found["reason"]) == ("stopped", "the service was shut down")
        assert found["n_samples"] == service.client.samples(run["id"])["n"] > 0.5 / DT_S
        service.idle("cell")
    finally:
        assert service.end() == (0, "")


def test_a_killed_recorder_ends_the_run_and_comes_back(simulator: Simulator, tmp_path: Path) -> None:
    service = Service(tmp_path, hardware("cell", simulator.url))
    try:
        run = start(service)
        recorder = next(p for p in children(service.process.pid) if "bench_service.recorder" in command_of(p))
        os.kill(recorder, signal.SIGKILL)
        killed_at_s = time.monotonic()
        until(lambda: not output_on(simulator), "output off")
        assert time.monotonic() - killed_at_s < stretched(SAFE_WITHIN_S)
        ended = service.client.wait_run(run["id"], timeout_s=PATIENCE_S)
        assert ended["state"] in ("fault", "interrupted") and ended["reason"]
        assert service.client.samples(run["id"])["n"] > 0
        until(lambda: service.client.health()["recorder"] == "running", "recorder again")
        until(lambda: service.client.acknowledge("cell")["state"] == "idle", "acknowledged")
        again = start(service, past_s=0.3)
        service.client.stop_run(again["id"])
        assert service.client.wait_run(again["id"], timeout_s=PATIENCE_S)["state"] == "stopped"
        assert "recorder" in {event["code"] for event in service.client.events()}
    finally:
        status, _ = service.end()
        assert status == 0


def test_another_device_is_told_over_restarts_of_the_service_until_somebody_has_looked(tmp_path: Path) -> None:
    first = Simulator(lock_step=False)
    benches = hardware("cell", first.url)
    service = Service(tmp_path, benches)
    service.idle("cell")
    assert service.end() == (0, "")
    first.end()
    other = Simulator(lock_step=False, port=first.port, serial=2)
    try:
        for _ in range(2):  # it is no longer new at the second start, and nobody has looked
            service = Service(tmp_path, benches)
            assert "another cycler than before: the serial number is '2', before it was '1'" in latched(service)
            assert service.end() == (0, "")
        service = Service(tmp_path, benches)
        until(lambda: service.client.bench("cell")["capabilities"], "connected")
        until(lambda: service.client.acknowledge("cell")["state"] == "idle", "acknowledged")
        assert service.end() == (0, "")
        service = Service(tmp_path, benches)
        service.idle("cell")
    finally:
        service.end()
        other.end()
