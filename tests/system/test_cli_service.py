"""`serve`, `run` and `export` as users see them: real processes, real Modbus TCP, one store."""

import contextlib
import json
import os
import selectors
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench_service.client import BenchClient, ClientError
from bench_service.exchange import read_run
from tests.patience import PATIENCE_S

CLI = (sys.executable, "-m", "bench_service.cli")
SLOWLY = ("--bench", "slow", "--out", "run.csv", "--dt", "0.1", "--json")
REAL_BENCH = """
[bench.slow]
url = "{}"
capacity_Ah = 2.5
limits = {{ voltage_V = [2.5, 4.2], current_A = [-5, 5], temperature_degC = [0, 50] }}
"""
WALL_CLOCK = "[bench.slow]\n[bench.slow.simulate]\nlock_step = false\nspeed = 1.0\n"


def environment() -> dict[str, str]:
    return {key: value for key, value in os.environ.items() if key != "BENCH_DATA_DIR"}


def start(folder: Path, *arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*CLI, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        env=environment(),
    )


def call(folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [*CLI, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment(), timeout=PATIENCE_S)


def refusal(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == 2, f"{done.returncode}: {done.stdout} {done.stderr}"
    assert done.stdout == ""
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    return done.stderr


def answer(done: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") == 1
    return json.loads(done.stdout)


def first_line(process: subprocess.Popen[str]) -> str:
    """The first line of a process that serves, within a time limit."""
    assert process.stdout is not None
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        assert selector.select(PATIENCE_S), "nothing was said in time"
    return process.stdout.readline()


def save_profile(folder: Path, *, rest_s: float = 10.0, duration_s: float = 60.0) -> Path:
    """A rest, a pulse of 1 A, a rest."""
    path = folder / "pulse.csv"
    path.write_text(f"time_s,current_A\n0,0\n{rest_s},1\n{duration_s - rest_s},0\n{duration_s},0\n")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("service")


@pytest.fixture(scope="module")
def service(folder: Path) -> Iterator[str]:
    """A service with the default configuration; its address."""
    with start(folder, "serve", "--port", 0, "--json") as process:
        try:
            yield json.loads(first_line(process))["address"]
        finally:
            process.send_signal(signal.SIGINT)
            rest, complaints = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, rest, complaints) == (0, "", "")


@pytest.fixture(scope="module")
def played(service: str, folder: Path) -> dict[str, Any]:
    """A run through the service, and what `run` said."""
    save_profile(folder)
    return answer(call(folder, "run", "pulse.csv", "--bench", "sim", "--out", "run.csv", "--dt", "0.5", "--json"))


def test_run_answers_the_contract(played: dict[str, Any], folder: Path) -> None:
    assert {"run", "file", "state", "samples", "missed_ticks", "reason"} <= set(played)
    assert played["state"] == "completed"
    assert played["file"] == "run.csv"
    assert played["missed_ticks"] == 0
    measured = read_run(folder / "run.csv")
    assert len(measured) == played["samples"] >= 120
    np.testing.assert_allclose(np.diff(measured.time_s), 0.5)
    assert np.nanmax(measured.current_A) == pytest.approx(1.0, abs=0.02)


def test_run_goes_through_the_service_that_holds_the_store(service: str, played: dict[str, Any]) -> None:
    with BenchClient(service) as client:
        assert client.run(played["run"])["n_samples"] == played["samples"]


def test_export_through_the_service(played: dict[str, Any], folder: Path) -> None:
    said = answer(call(folder, "export", played["run"], "--format", "bdf", "--out", "a.bdf.csv", "--json"))
    assert {"run", "file", "state", "samples", "missed_ticks", "reason"} <= set(said)
    assert said["samples"] == played["samples"]
    assert (folder / "a.bdf.csv").read_text().startswith("Test Time / s,Current / A,Voltage / V,")
    mine, theirs = read_run(folder / "a.bdf.csv"), read_run(folder / "run.csv")
    np.testing.assert_array_equal(mine.voltage_V, theirs.voltage_V)
    np.testing.assert_array_equal(mine.time_s, theirs.time_s)


def test_export_of_an_unknown_run(service: str, folder: Path) -> None:
    done = call(folder, "export", "nowhere", "--format", "bdf", "--out", "nowhere.csv")
    assert "unknown run 'nowhere'" in refusal(done)
    assert not (folder / "nowhere.csv").exists()


@pytest.mark.parametrize(
    ("profile", "bench", "reason"),
    [
        ("time_s,current_A\n0,0\n10,50\n20,0\n", "sim", "limit"),
        ("time_s,current_A\n0,0\n10,nan\n20,0\n", "sim", "row 3: current_A is missing"),
        ("time_s,current_A\n0,0\n10,1\n20,0\n", "moon", "unknown bench 'moon'"),
        ("t,i\n0,0\n10,1\n20,0\n", "sim", "wrong columns"),
    ],
)
def test_run_refuses(profile: str, bench: str, reason: str, service: str, tmp_path: Path, folder: Path) -> None:
    (tmp_path / "p.csv").write_text(profile)
    out = tmp_path / "run.csv"
    done = call(folder, "run", tmp_path / "p.csv", "--bench", bench, "--out", out)
    assert reason in refusal(done)
    assert not out.exists()


def test_second_service_on_the_data(service: str, folder: Path) -> None:
    message = refusal(call(folder, "serve", "--port", 0))
    assert "is being written by" in message
    assert service in message


def test_serve_on_a_port_in_use(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        message = refusal(call(tmp_path, "serve", "--port", port))
    assert f"127.0.0.1:{port}" in message
    assert not (tmp_path / "bench-data").exists()


def test_serve_with_a_bad_configuration(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text("[bench.a]\nspeed = 3\n")
    assert "bench.a.speed: unknown key" in refusal(call(tmp_path, "serve"))


def test_run_and_export_without_a_service(tmp_path: Path) -> None:
    save_profile(tmp_path)
    said = answer(call(tmp_path, "run", "pulse.csv", "--bench", "sim", "--out", "run.bdf.csv", "--json"))
    assert said["state"] == "completed"
    assert (tmp_path / "run.bdf.csv").read_text().startswith("Test Time / s,")
    answer(call(tmp_path, "export", said["run"], "--format", "csv", "--out", "again.csv", "--json"))
    assert len(read_run(tmp_path / "again.csv")) == said["samples"]


def test_export_without_any_store(tmp_path: Path) -> None:
    message = refusal(call(tmp_path, "export", "0123", "--format", "bdf", "--out", "a.csv"))
    assert "no runs are stored in bench-data" in message
    assert list(tmp_path.iterdir()) == []


def wait_for_run(folder: Path) -> None:
    """Wait until a run of a service in `folder` has stored samples."""
    deadline_s = time.monotonic() + PATIENCE_S
    lock = folder / "bench-data" / "meta.lock"
    while time.monotonic() < deadline_s:
        # The file is there before the service answers, and is empty for an instant.
        with contextlib.suppress(OSError, ValueError, ClientError):
            url = json.loads(lock.read_text())["url"]
            if url is not None:
                with BenchClient(url, timeout_s=30.0) as client:
                    live = client.bench("slow")["live"]
                if live is not None and live["run_id"] is not None and live["time_s"] > 0.5:
                    return
        time.sleep(0.05)
    raise AssertionError("no run within the time limit")


def kill_simulator_during_run(folder: Path) -> tuple[int, dict[str, Any]]:
    """Play on a simulated cycler that falls silent in the middle of a pulse; exit status and answer."""
    with start(folder, "simulate", "--json") as simulator:
        try:
            address = json.loads(first_line(simulator))["address"]
            (folder / "bench.toml").write_text(REAL_BENCH.format(address))
            save_profile(folder, rest_s=0.2, duration_s=600.0)
            with start(folder, "run", "pulse.csv", *SLOWLY) as process:
                try:
                    wait_for_run(folder)
                    simulator.kill()
                    out, _ = process.communicate(timeout=PATIENCE_S)
                finally:
                    process.kill()
        finally:
            simulator.kill()
    return process.returncode, json.loads(out)


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_a_run_that_is_interrupted_ends_safely_and_keeps_its_samples(end: signal.Signals, tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(WALL_CLOCK)
    save_profile(tmp_path, rest_s=0.2, duration_s=600.0)
    with start(tmp_path, "run", "pulse.csv", *SLOWLY) as process:
        try:
            wait_for_run(tmp_path)
            process.send_signal(end)
            out, complaints = process.communicate(timeout=PATIENCE_S)
        finally:
            process.kill()
    assert process.returncode == 1, complaints
    said = json.loads(out)
    assert said["state"] == "stopped"
    assert said["samples"] > 5
    lines = (tmp_path / "run.csv").read_text().splitlines()
    assert len(lines) == said["samples"] + 1


def test_a_run_whose_cycler_falls_silent_ends_in_fault_until_acknowledged(tmp_path: Path) -> None:
    status, said = kill_simulator_during_run(tmp_path)
    assert status == 1
    assert said["state"] == "fault"
    assert said["reason"]
    assert len((tmp_path / "run.csv").read_text().splitlines()) == said["samples"] + 1
    # This run is to complete: a simulated cycler may not get a processor for half a second on a loaded machine.
    (tmp_path / "bench.toml").write_text("[bench.slow]\ntimeout_s = 5.0\nsimulate = {}\n")
    save_profile(tmp_path)
    refused = refusal(call(tmp_path, "run", "pulse.csv", *SLOWLY))
    assert "acknowledge" in refused
    assert answer(call(tmp_path, "run", "pulse.csv", *SLOWLY, "--acknowledge"))["state"] == "completed"
