"""A temperature chamber as the second device of a bench, over real Modbus TCP: real processes, real kills."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from control_rig import Rig, request, rig, send_signal, settings

from bench_service.bench.chamber.settings import ChamberSettings as BenchChamber
from bench_service.bench.request import ProtocolOrder, RunRequest
from bench_service.store.samples import SampleReader
from drivers.chamber import ChamberReading
from drivers.factory import open_chamber
from simulators.chamber import Chamber, ChamberSettings
from simulators.chamber_server import chamber_beside
from simulators.modbus_actions import delay
from tests.patience import PATIENCE_S, holds, stretched

SOAK = {"step": "soak", "temperature_degC": 35, "within_K": 1, "hold_s": 60}
PULSE = {"step": "pulse", "rate_C": -1, "on_s": 30, "off_s": 30, "count": 1}
ROOM = [{"step": "chamber", "temperature_degC": 25}, {"step": "rest", "until": {"time_s": 600}}]


def cli(folder: Path, *command: str, status: int = 0) -> Any:
    done = subprocess.run(
        [sys.executable, "-m", "bench_service.cli", *command, "--config", "bench.toml"],
        cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, env=dict(os.environ), check=False,
    )  # fmt: skip
    assert done.returncode == status, done.stderr
    return json.loads(done.stdout) if status == 0 else done.stderr


def test_a_cell_is_warmed_pulsed_and_let_cool_in_lock_step(tmp_path: Path) -> None:
    document = {"schema": "bench-protocol-1", "name": "warm", "steps": [SOAK, PULSE, *ROOM]}
    (tmp_path / "p.json").write_text(json.dumps(document))
    bench = "[bench.sim]\nsimulate = {seed = 4}\n"
    (tmp_path / "bench.toml").write_text(bench)
    refused = cli(tmp_path, "protocol", "check", "p.json", "--json", status=2)
    assert "step 1 (soak) needs a temperature chamber, and the bench has none at steps.0" in refused
    (tmp_path / "bench.toml").write_text(bench + "[bench.sim.chamber]\ntolerance_K = 0.5\n")
    answer = cli(
        tmp_path, "run", "p.json", "--bench", "sim", "--out", "run.csv", "--initial-soc", "0.5", "--dt", "5", "--json"
    )
    assert (answer["state"], answer["missed_ticks"]) == ("completed", 0), answer
    rows = np.genfromtxt(tmp_path / "run.csv", delimiter=",", names=True)
    soak, pulse = rows[rows["step_count"] == 1], rows[rows["step_count"] == 2]
    # 10 K at 3 K/min, then as a lag; the cell needs longer.
    assert soak["ambient_degC"][0] == 25.0 and np.diff(soak["ambient_degC"]).max() <= 0.26
    assert np.abs(soak["ambient_degC"][-13:] - 35.0).max() <= 0.5
    assert np.abs(soak["temperature_degC"][-13:] - 35.0).max() <= 1.0 and np.all(soak["setpoint_A"] == 0.0)
    assert not (np.abs(soak["temperature_degC"][:-13] - 35.0) <= 1.0)[-2:].all(), "it ends as soon as it may"
    assert np.allclose(pulse["current_A"][1:], -2.5, atol=0.01)
    assert np.all(np.diff(rows["ambient_degC"][rows["step_count"] == 4]) <= 0.02)
    assert abs(rows["ambient_degC"][-1] - 25.0) < 0.5


def protocol(*steps: dict[str, Any], run_id: str = "run-1") -> RunRequest:
    document = {"schema": "bench-protocol-1", "name": "test", "steps": list(steps)}
    order = ProtocolOrder(document=document, standing=None, expected_s=None)
    return request([], [], run_id=run_id, protocol=order)


async def chamber_of(bench: Rig) -> ChamberReading:
    """Read the chamber over a connection of the test's own."""
    chamber = open_chamber(bench.simulator.chamber_url, "generic_chamber", 5.0)
    await chamber.connect()
    try:
        return await chamber.sample()
    finally:
        await chamber.close()
        await asyncio.sleep(0)


async def until_chamber(bench: Rig, *, on: bool) -> ChamberReading:
    async with asyncio.timeout(PATIENCE_S):
        while (seen := await chamber_of(bench)).on is not on:
            await asyncio.sleep(0.02)
    return seen


FEW = 5  # a tick that waited for a chamber would have missed at least as many; a busy machine misses some
WARM = {"step": "chamber", "temperature_degC": 40}
CURRENT = {"step": "constant_current", "current_A": 1, "until": {"time_s": 600}}


async def test_a_stop_brings_cycler_and_chamber_to_rest_and_so_does_a_new_process_after_a_kill(tmp_path: Path) -> None:
    async with rig(tmp_path, lock_step=False, chamber_faults="") as bench:
        await bench.until(lambda: bench.supervisor.status.chamber["online"], "the chamber answers")
        assert bench.supervisor.status.chamber["maker"] == "bench"
        bench.begin(protocol(WARM, CURRENT))
        seen = await until_chamber(bench, on=True)
        assert seen.setpoint_degC == 40.0
        await bench.running(1.0)
        await bench.until(lambda: (bench.heard.live[-1]["ambient_degC"] or 0.0) > 25.2, "warmer")
        assert bench.heard.live[-1]["chamber_setpoint_degC"] == 40.0 and bench.heard.live[-1]["chamber_on"]
        bench.supervisor.stop("enough")
        await bench.output_is_off(0.5)
        ended = await bench.end_of("run-1")
        assert ended["state"] == "stopped" and ended["missed_ticks"] < FEW
        assert not (await chamber_of(bench)).on, "off when the end of the run is told"
        samples = SampleReader(tmp_path).read("run-1").columns
        assert samples["ambient_degC"][-1] > samples["ambient_degC"][0]
        # The same with the control process killed: the next one finds the chamber warm.
        bench.heard.ended.clear()
        await bench.supervisor.wait_for("idle", timeout_s=PATIENCE_S)
        bench.begin(protocol(WARM, CURRENT, run_id="run-2"))
        await until_chamber(bench, on=True)
        send_signal(bench.supervisor.pid, signal.SIGKILL)
        assert (await bench.end_of("run-2"))["state"] == "interrupted"
        await until_chamber(bench, on=False)


async def test_a_slow_chamber_delays_neither_ticks_nor_stop_and_a_dead_one_ends_the_run_safely(tmp_path: Path) -> None:
    device, server = chamber_beside(Chamber(ChamberSettings()), lambda: None)
    url = f"modbus-tcp://127.0.0.1:{await server.start('127.0.0.1', 0)}"
    chamber = BenchChamber(url, "generic_chamber", (0.0, 50.0), timeout_s=0.5, lost_s=2.0)
    async with rig(tmp_path, lock_step=False, chamber=replace(chamber, lost_s=60.0)) as bench:
        await bench.until(lambda: bench.supervisor.status.chamber["online"], "the chamber answers")
        bench.begin(protocol(WARM, CURRENT))
        await holds(lambda: device.chamber.on, "told")
        server.on_request = lambda frame: delay(3.0)
        await bench.until(lambda: bench.heard.live[-1]["ambient_degC"] is None, "what is late is missing")
        began_s = time.monotonic()
        bench.supervisor.stop("enough")
        await bench.output_is_off(0.5)
        assert time.monotonic() - began_s < stretched(0.7)
        ended = await bench.end_of("run-1")
        assert ended["state"] == "stopped" and ended["missed_ticks"] < FEW
        assert "chamber_not_told" in bench.heard.codes("error") and device.chamber.on
        server.on_request = None
        await holds(lambda: not device.chamber.on, "it is told again until it is off")
    async with rig(tmp_path / "other", lock_step=False, chamber=chamber) as bench:
        await bench.until(lambda: bench.supervisor.status.chamber["online"], "the chamber answers")
        bench.begin(protocol(WARM, CURRENT))
        await bench.running(0.5)
        await server.close()
        ended = await bench.end_of("run-1")
        assert ended["state"] == "fault" and ended["missed_ticks"] < FEW
        assert "the temperature chamber has not answered for 2" in ended["reason"]
        await bench.output_is_off(0.1)
        # Acknowledged, but there is still no chamber: no run.
        bench.heard.ended.clear()
        bench.supervisor.acknowledge()
        await bench.supervisor.wait_for("idle", timeout_s=PATIENCE_S)
        refused = await bench.play(protocol(CURRENT, run_id="run-2"))
        assert refused["state"] == "fault" and "the chamber does not answer" in refused["reason"]


def test_settings_of_a_chamber_reach_the_control_process() -> None:
    chamber = BenchChamber("modbus-tcp://h:1", "generic_chamber", (0.0, 50.0), at_end=20.0)
    made = settings(type("Simulator", (), {"url": "modbus-tcp://h:2", "chamber_url": ""}), chamber=chamber)
    assert type(made).from_json(made.to_json()) == made
