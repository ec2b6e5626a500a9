"""Stop and acknowledge past the service: on the control process's own port, and what becomes of a silent service."""

import asyncio
import json
import os
import signal
import socket
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from cli_rig import answer, call, refusal
from control_rig import Rig, Simulator, request, rig
from service_rig import Service, hardware, until
from test_service_death import reading

from bench_service.bench.direct.port import MOST_CONNECTIONS
from bench_service.client import ClientError
from bench_service.stop_tickets import FOLDER
from bench_service.streams import Flag
from tests.patience import PATIENCE_S, stretched

LONG = [0.0, 3600.0], [1.5, 0.0]
ORIGIN = "http://127.0.0.1:8000"
LEASE_S = 2.5


@pytest.fixture
async def wall(tmp_path: Path) -> AsyncIterator[Rig]:
    async with rig(tmp_path, lock_step=False, origins=(ORIGIN,), lease_s=LEASE_S) as bench:
        yield bench


async def ask(bench: Rig, operation: str, **headers: str) -> httpx.Response:
    ticket = json.loads((bench.data_dir / FOLDER / "sim.json").read_text())
    async with httpx.AsyncClient(trust_env=False) as client:
        given = {"authorization": f"Bearer {ticket['token']}"} | headers
        return await client.post(f"{ticket['url']}/{operation}", headers=given, timeout=PATIENCE_S)


async def test_stop_past_the_service(wall: Rig) -> None:
    folder, file = wall.data_dir / FOLDER, wall.data_dir / FOLDER / "sim.json"
    assert (folder.stat().st_mode & 0o777, file.stat().st_mode & 0o777) == (0o700, 0o600)
    wall.begin(request(*LONG, dt_s=0.05))
    await wall.running(0.2)
    for wrong in ("Bearer wrong", ""):
        assert (await ask(wall, "stop", authorization=wrong)).status_code == 401
    assert (await ask(wall, "stop", origin="http://elsewhere")).status_code == 403
    assert wall.supervisor.status.state == "running"
    # Connections that say nothing take no place for long.
    port = int(str(json.loads(file.read_text())["url"]).rpartition(":")[2])
    silent = [socket.create_connection(("127.0.0.1", port)) for _ in range(MOST_CONNECTIONS + 8)]
    answer = await ask(wall, "stop", origin=ORIGIN)
    assert (answer.status_code, answer.json()["state"]) == (200, "stopping")
    assert answer.headers["access-control-allow-origin"] == ORIGIN
    await wall.output_is_off(1.0)
    ended = await wall.end_of("run-1")
    assert (ended["state"], ended["reason"]) == ("stopped", "stopped past the service")
    for sock in silent:
        sock.close()


async def test_a_fault_is_acknowledged_past_the_service_and_none_before_its_time(wall: Rig) -> None:
    assert (await ask(wall, "acknowledge")).json()["state"] == "idle"
    wall.begin(request(*LONG, dt_s=0.05))
    await wall.running(0.1)
    assert (await ask(wall, "acknowledge")).json()["state"] == "running"
    wall.recorder.kill()
    await wall.end_of("run-1")
    await wall.supervisor.wait_for("fault", timeout_s=PATIENCE_S)


@pytest.mark.parametrize("finish_alone", [False, True])
async def test_a_service_that_is_stopped_loses_its_lease(
    wall: Rig, monkeypatch: pytest.MonkeyPatch, finish_alone: bool
) -> None:
    """The supervisor here says nothing for as long as a stopped process would."""
    wall.begin(request([0.0, 4.0], [1.0, 0.0], dt_s=0.05, finish_alone=finish_alone))
    await wall.running(0.1)
    sent: list[Any] = []
    monkeypatch.setattr(wall.supervisor._link, "send", lambda *frame: sent.append(frame))
    began_s = time.monotonic()
    ended = await wall.end_of("run-1")
    if finish_alone:
        assert ended["state"] == "completed"
    else:
        assert ended["state"] == "interrupted" and "silent for " in ended["reason"]
        assert LEASE_S - 1.1 < time.monotonic() - began_s < stretched(LEASE_S + 1.5)
    assert not (await wall.reading()).output_on
    monkeypatch.undo()
    await asyncio.sleep(0)


async def test_a_run_that_may_finishes_without_the_service(wall: Rig) -> None:
    wall.begin(request([0.0, 2.0], [1.0, 0.0], dt_s=0.05, finish_alone=True))
    await wall.running(0.1)
    pid, process = wall.supervisor.pid, wall.supervisor._process
    assert wall.supervisor._link is not None and process is not None
    wall.supervisor._link._sock.shutdown(socket.SHUT_RDWR)  # as if the service had died
    assert (await wall.reading()).output_on
    while process.poll() is None:
        await asyncio.sleep(0.02)
    assert not (await wall.reading()).output_on
    assert pid is not None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, signal.SIGTERM)


def test_stop_while_the_service_is_stopped(tmp_path: Path) -> None:
    """By the command line and by the client; the service says afterwards what has happened."""
    simulator = Simulator(lock_step=False)
    service = Service(tmp_path, hardware("cell", simulator.url))
    arguments = ("stop", "cell", "--json", "--config", tmp_path / "bench.toml")
    try:
        service.idle("cell")
        profile = service.client.upload_profile("steady", [0, 600], [1.0, 0.0])
        assert answer(call(*arguments))["benches"][0]["state"] == "idle"
        for reason in ("stopped from the command line", "stopped by a client"):
            run = service.client.start_run("cell", profile["id"], 0.05, 0.5)
            until(lambda: (service.client.bench("cell")["live"] or {}).get("run_id"), "run in progress")
            service.process.send_signal(signal.SIGSTOP)
            if reason.endswith("client"):
                assert service.client.stop_bench("cell")["state"] == "stopping"
            told = answer(call(*arguments))["benches"][0]
            assert (told["bench"], told["state"], told["way"]) == ("cell", "idle", "direct")
            assert not asyncio.run(reading(simulator.url)).output_on
            service.process.send_signal(signal.SIGCONT)
            ended = service.client.wait_run(run["id"], timeout_s=PATIENCE_S)
            assert ended["state"] == "stopped"
            assert ended["reason"] == reason
    finally:
        service.process.send_signal(signal.SIGCONT)
        service.end()
        simulator.end()
    nobody = call(*arguments)
    assert nobody.returncode == 1 and json.loads(nobody.stdout)["benches"][0]["state"] is None
    assert "no service runs there" in refusal(call("stop", "other", *arguments[2:]))
    assert "not both" in refusal(call(*arguments, "--all"))


def test_a_run_is_paused_and_goes_on(tmp_path: Path) -> None:
    simulator = Simulator(lock_step=False)
    service = Service(tmp_path, hardware("cell", simulator.url))
    client = service.client
    try:
        service.idle("cell")
        with pytest.raises(ClientError, match="no run to hold"):
            client.pause_bench("cell")
        profile = client.upload_profile("steady", [0, 3], [1.0, 0.0])
        run = client.start_run("cell", profile["id"], 0.1, 0.5)
        until(lambda: (client.bench("cell")["live"] or {}).get("run_id"), "run in progress")
        client.pause_bench("cell")
        until(lambda: client.run(run["id"])["state"] == "paused", "paused")
        assert client.bench("cell")["state"] == "paused"
        assert not asyncio.run(reading(simulator.url)).output_on
        client.resume_bench("cell")
        until(lambda: client.run(run["id"])["state"] == "running", "running again")
        ended = client.wait_run(run["id"], timeout_s=PATIENCE_S)
        assert ended["state"] == "completed", ended
        columns = client.samples(run["id"])["columns"]
        paused = [bool(flags & Flag.PAUSED) for flags in columns["flags"]]
        assert any(paused) and not paused[0] and not paused[-1]
        assert sum(not each for each in paused) >= 30
        codes = [event["code"] for event in client.events(run["id"])]
        assert {"paused", "resumed", "run_completed"} <= set(codes)
    finally:
        service.end()
        simulator.end()
