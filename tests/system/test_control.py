"""The control process with a real simulator, a real recorder and real kills."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from control_rig import WIDE, Listener, Rig, Simulator, free_port, request, rig, send_signal, settings

from bench_service.bench.settings import BenchSettings
from bench_service.bench.supervisor import BenchSupervisor
from bench_service.errors import BenchBusyError
from bench_service.recorder.client import RecorderProcess
from bench_service.store.samples import SampleReader
from bench_service.streams import OBSERVER, Flag
from drivers.cycler import DeviceLimits
from drivers.factory import open_cycler
from models.network.local_model_network import LocalModelNetwork
from models.network.partition import Partition
from models.network.regression import CellContext
from models.network.structure import minimal_structure
from models.observer import FuzzyObserver
from tests.patience import PATIENCE_S, holds, stretched

LONG = [0.0, 3600.0], [1.5, 0.0]


@pytest.fixture
async def lock_step(tmp_path: Path) -> AsyncIterator[Rig]:
    async with rig(tmp_path, lock_step=True) as bench:
        yield bench


@pytest.fixture
async def wall(tmp_path: Path) -> AsyncIterator[Rig]:
    async with rig(tmp_path, lock_step=False) as bench:
        yield bench


def stored(data_dir: Path, run_id: str = "run-1") -> dict[str, np.ndarray]:
    with SampleReader(data_dir) as reader:
        data = reader.read(run_id)
        assert not data.gaps
        return dict(data.columns)


def closed_state(data_dir: Path, run_id: str = "run-1") -> str | None:
    with SampleReader(data_dir) as reader:
        closed = reader.closed(run_id)
        return None if closed is None else closed.state


async def test_lock_step_run_is_stored_completely(lock_step: Rig) -> None:
    ended = await lock_step.play(request([0, 20, 40, 60], [2.0, -2.0, 0.0, 0.0], settle_s=0.5))
    assert (ended["state"], ended["n_samples"], ended["missed_ticks"]) == ("completed", 601, 0)
    columns = stored(lock_step.data_dir)
    assert columns["time_s"].tolist() == [k * 0.1 for k in range(601)]
    # The current of a sample is what flowed in the interval before it.
    expected = np.repeat([0.0, 2.0, -2.0, 0.0], [1, 200, 200, 200])
    assert columns["setpoint_A"].tolist() == expected.tolist()
    assert np.abs(columns["current_A"] - expected).max() < 0.05
    assert not columns["lateness_s"].any()
    settling = np.flatnonzero(columns["flags"] & Flag.SETTLING)
    assert settling.tolist() == [k + j for k in (1, 201, 401) for j in range(4)]
    with SampleReader(lock_step.data_dir) as reader:
        assert reader.content_hash("run-1") == ended["sha256"]
    assert not (await lock_step.reading()).output_on
    assert lock_step.supervisor.status.state == "idle"
    assert lock_step.heard.codes("error") == []


async def test_two_lock_step_runs_are_equal_to_the_bit(tmp_path: Path) -> None:
    hashes = []
    for idle_samples in (0, 2):
        async with rig(tmp_path / str(idle_samples), lock_step=True) as bench:
            # Idle sampling before the run must leave no trace in it.
            live = bench.heard.live
            await bench.until(lambda live=live, n=idle_samples: len(live) >= n, "idle samples")
            hashes.append((await bench.play(request([0, 30, 60], [3.0, -3.0, 0.0])))["sha256"])
    assert hashes[0] == hashes[1]


async def test_wall_clock_run(wall: Rig) -> None:
    ended = await wall.play(request([0, 1, 2], [1.0, -1.0, 0.0], dt_s=0.05, settle_s=0.1))
    assert ended["state"] == "completed", ended
    columns = stored(wall.data_dir)
    assert ended["n_samples"] + ended["missed_ticks"] == 41
    assert len(columns["time_s"]) == ended["n_samples"]
    # A tick begins late by its lateness; what is left is the time of the reading. One tick holds one sample.
    read_s = columns["time_s"] - columns["lateness_s"]
    grid = np.floor(read_s / 0.05 + 1e-6)
    for k in range(len(grid) - 2, -1, -1):
        grid[k] = min(grid[k], grid[k + 1] - 1)
    assert grid[0] == 0 and (np.diff(grid) >= 1).all()
    assert np.abs(read_s - grid * 0.05).max() < stretched(0.045)
    gaps = np.flatnonzero(columns["flags"] & Flag.GAP_BEFORE)
    assert (len(gaps) > 0) == (ended["missed_ticks"] > 0)


async def test_slow_wall_clock_run_feeds_the_watchdog_between_samples(wall: Rig) -> None:
    ended = await wall.play(request([0, 1.4], [1.0, 0.0], dt_s=0.7))
    assert (ended["state"], ended["n_samples"]) == ("completed", 3), ended
    assert stored(wall.data_dir)["setpoint_A"].tolist() == [0.0, 1.0, 1.0]


async def test_stop(wall: Rig) -> None:
    wall.begin(request(*LONG, dt_s=0.05))
    await wall.running(0.2)
    with pytest.raises(BenchBusyError, match="run-1"):
        wall.supervisor.start_run(request(*LONG, run_id="run-2"))
    wall.supervisor.stop("enough seen")
    await wall.output_is_off(1.0)
    ended = await wall.end_of("run-1")
    assert (ended["state"], ended["reason"]) == ("stopped", "enough seen")
    assert ended["n_samples"] == len(stored(wall.data_dir)["time_s"]) > 3
    assert wall.supervisor.status.state == "idle"


async def test_simulator_killed_in_the_middle_of_a_pulse(lock_step: Rig) -> None:
    bench = lock_step
    bench.begin(request([0, 36000], [1.0, 0.0], limits=replace(WIDE, soc=(0.0, 1.0)), capacity_Ah=25.0))
    await bench.running(1.0)
    port = bench.simulator.port
    bench.simulator.kill()
    ended = await bench.end_of("run-1")
    assert ended["state"] == "fault"
    assert "cycler" in ended["reason"]
    assert bench.heard.codes("error") == ["cycler"]
    assert ended["n_samples"] == len(stored(bench.data_dir)["time_s"])
    assert closed_state(bench.data_dir) == "fault"
    # Back again: identified, made safe, and nothing resumes before a person has looked.
    bench.simulator = Simulator(lock_step=True, port=port)
    await bench.until(lambda: "connected" in bench.heard.codes("info")[1:], "reconnected")
    assert bench.supervisor.status.state == "fault"
    with pytest.raises(BenchBusyError, match="acknowledge"):
        bench.supervisor.start_run(request(*LONG, run_id="run-2"))
    bench.supervisor.acknowledge()
    await bench.supervisor.wait_for("idle", timeout_s=PATIENCE_S)
    assert not (await bench.reading()).output_on


async def test_over_voltage_trips_and_latches(lock_step: Rig) -> None:
    rest_V = (await lock_step.reading()).voltage_V
    limits = replace(WIDE, voltage_V=(2.5, rest_V + 0.02))
    ended = await lock_step.play(request([0, 10, 600], [0.0, 9.0, 0.0], limits=limits))
    assert ended["state"] == "fault"
    assert "voltage" in ended["reason"] and "outside" in ended["reason"]
    assert lock_step.heard.codes("error") == ["voltage_limit"]
    columns = stored(lock_step.data_dir)
    assert len(columns["time_s"]) == ended["n_samples"]
    assert columns["voltage_V"][-1] > rest_V + 0.02 >= columns["voltage_V"][:-1].max()
    assert not (await lock_step.reading()).output_on
    assert lock_step.supervisor.status.state == "fault"


BAD_REQUESTS = [
    ({"current_A": np.array([20.0, 0.0])}, "20 A"),
    ({"limits": replace(WIDE, voltage_V=(2.0, 4.3))}, "voltage_V"),
    ({"initial_soc": 0.999, "time_s": np.array([0.0, 3600.0])}, "state of charge"),
    ({"limits": replace(WIDE, duration_s=5.0)}, "5 s"),
    ({"current_A": np.array([np.nan, 0.0])}, "finite"),
]


async def test_bad_requests_are_refused_before_any_command(lock_step: Rig) -> None:
    for number, (change, message) in enumerate(BAD_REQUESTS):
        bad = replace(request([0, 10], [1.0, 0.0], run_id=f"run-{number}"), **change)
        lock_step.begin(bad)
        await lock_step.until(lambda n=number: len(lock_step.heard.ended) > n, message)
        ended = lock_step.heard.ended[-1]
        assert (ended["run_id"], ended["state"], ended["n_samples"]) == (f"run-{number}", "fault", 0)
        assert "refused" in ended["reason"] and message in ended["reason"]
        assert lock_step.supervisor.status.state == "idle"
    assert "remote" not in (await lock_step.reading()).status


async def test_other_limits_hold_from_the_next_control_process_on(lock_step: Rig) -> None:
    before, started = lock_step.supervisor.pid, replace(WIDE, current_A=(-1.0, 1.0))
    lock_step.supervisor.renew(limits=started)
    await lock_step.until(lambda: lock_step.supervisor.pid not in (None, before), "a new control process")
    await lock_step.supervisor.wait_for("idle", timeout_s=PATIENCE_S)
    assert lock_step.heard.codes("error") == []  # it was asked to
    ended = await lock_step.play(request([0, 10], [2.0, 0.0]))
    assert ended["state"] == "fault" and "refused" in ended["reason"] and "current_A" in ended["reason"]


async def test_long_watchdog_needs_an_interlock(tmp_path: Path) -> None:
    async with rig(tmp_path, lock_step=True, watchdog_s=5.0) as bench:
        ended = await bench.play(request([0, 1], [1.0, 0.0]))
    assert "external_interlock" in ended["reason"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
async def test_control_process_ended_from_outside(wall: Rig, number: signal.Signals) -> None:
    wall.begin(request(*LONG, dt_s=0.05))
    await wall.running(0.5)
    pid = wall.supervisor.pid
    send_signal(pid, number)
    await wall.output_is_off(2.0)
    ended = await wall.end_of("run-1")
    assert ended["state"] == "interrupted"
    await wall.until(lambda: closed_state(wall.data_dir) == "interrupted", "run closed")
    assert len(stored(wall.data_dir)["time_s"]) > 5
    # A new process takes over and makes safe; a person looks before the next run.
    await wall.until(lambda: wall.supervisor.pid not in (None, pid), "restarted")
    await wall.until(lambda: wall.heard.codes("info").count("connected") == 2, "connected")
    await wall.supervisor.wait_for("fault", timeout_s=PATIENCE_S)
    # The acknowledgement outlives a process that dies with it in its queue, as they do where their recorder has died.
    pid = wall.supervisor.pid
    send_signal(pid, signal.SIGSTOP)
    wall.supervisor.acknowledge()
    send_signal(pid, signal.SIGKILL)
    await wall.supervisor.wait_for("idle", timeout_s=PATIENCE_S)
    assert wall.supervisor.pid != pid


async def test_hung_control_process_is_cut_off_by_the_device(wall: Rig) -> None:
    wall.begin(request(*LONG, dt_s=0.05))
    await wall.running(0.3)
    send_signal(wall.supervisor.pid, signal.SIGSTOP)
    reading = await wall.output_is_off(2.0)
    assert "watchdog" in reading.alarms
    send_signal(wall.supervisor.pid, signal.SIGCONT)
    ended = await wall.end_of("run-1")
    # Where it was stopped decides what it sees first: the alarm, its reading's age, or an answer that came too late.
    assert ended["state"] == "fault"
    assert wall.heard.codes("error") in (["device_alarm"], ["reading_too_old"], ["cycler"])
    assert not (await wall.reading()).output_on


async def test_recorder_killed(wall: Rig) -> None:
    wall.begin(request(*LONG, dt_s=0.05))
    await wall.running(1.0)
    wall.recorder.kill()
    await wall.output_is_off(1.0)
    ended = await wall.end_of("run-1")
    assert ended["state"] == "fault" and "recorder is gone" in ended["reason"]
    assert 0 < ended["n_samples"] <= len(stored(wall.data_dir)["time_s"])


_API = """
import asyncio, sys
sys.path.insert(0, {here!r})
from pathlib import Path
from control_rig import Listener, request
from bench_service.bench.settings import BenchSettings
from bench_service.bench.supervisor import BenchSupervisor
from bench_service.recorder.client import RecorderProcess

async def main():
    recorder = RecorderProcess.start(Path({data!r}), commit_period_s=0.2)
    heard = Listener()
    supervisor = BenchSupervisor(BenchSettings.from_json({settings!r}), recorder.attach, heard)
    await supervisor.start()
    await supervisor.wait_for("idle", timeout_s={patience})
    supervisor.start_run(request([0.0, 3600.0], [1.5, 0.0], dt_s=0.05))
    while not any(live["run_id"] and live["time_s"] > 0.5 for live in heard.live):
        await asyncio.sleep(0.01)
    print("running", flush=True)
    await asyncio.sleep(3600)

asyncio.run(main())
"""


async def test_api_killed_in_the_middle_of_a_run(tmp_path: Path) -> None:
    simulator = Simulator(lock_step=False)
    here = str(Path(__file__).parent)
    code = _API.format(here=here, data=str(tmp_path), settings=settings(simulator).to_json(), patience=PATIENCE_S)
    api = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    try:
        assert api.stdout is not None
        assert await asyncio.to_thread(api.stdout.readline) == "running\n"
        api.kill()
        killed_s = time.monotonic()
        cycler = open_cycler(simulator.url, "generic", 0.5)
        await cycler.connect()
        while (reading := await cycler.sample()).output_on:
            await asyncio.sleep(0.01)
        assert time.monotonic() - killed_s < stretched(2.0)
        assert not reading.alarms, "the watchdog was faster than the control process"
        await cycler.close()
        await holds(lambda: closed_state(tmp_path), "run closed", every_s=0.02)
        assert closed_state(tmp_path) == "interrupted"
        assert stored(tmp_path)["time_s"][-1] > 0.5
        # The store is free again at once: both processes have ended.
        RecorderProcess.start(tmp_path).stop()
    finally:
        api.kill()
        api.wait()
        if api.stdout is not None:
            api.stdout.close()
        simulator.end()


async def test_bench_without_cycler_stays_offline_and_ends(tmp_path: Path) -> None:
    recorder = RecorderProcess.start(tmp_path)
    heard = Listener()
    bench = BenchSettings("sim", f"modbus-tcp://127.0.0.1:{free_port()}", "generic", WIDE)
    supervisor = BenchSupervisor(bench, recorder.attach, heard)
    await supervisor.start()
    await holds(lambda: "offline" in heard.codes("warning"), "offline")
    assert supervisor.status.state == "offline"
    await supervisor.close()
    assert recorder.stop()
    assert heard.codes("warning") == ["offline"]


async def test_service_shut_down_in_the_middle_of_a_run(wall: Rig) -> None:
    wall.begin(request(*LONG, dt_s=0.05))
    await wall.running(0.2)
    await wall.supervisor.close()
    (ended,) = wall.heard.ended
    assert (ended["state"], ended["reason"]) == ("stopped", "the service was shut down")
    assert ended["n_samples"] == len(stored(wall.data_dir)["time_s"])
    assert not (await wall.reading()).output_on


async def test_output_switched_on_by_somebody_else_is_switched_off(wall: Rig) -> None:
    other = open_cycler(wall.simulator.url, "generic", 0.5)
    await other.connect()
    limits = DeviceLimits((2.5, 4.3), (-9.0, 9.0), (-20.0, 60.0), None)
    await other.acquire(limits, 2.0, None)
    await other.output(True)
    await other.close()
    await wall.supervisor.wait_for("fault", timeout_s=PATIENCE_S)
    assert wall.heard.codes("error") == ["unexpected_output"]
    assert (await wall.reading()).alarms == frozenset(), "the watchdog was faster"
    assert not (await wall.reading()).output_on


def linear_cell_model(dt_s: float) -> LocalModelNetwork:
    """Return a network of one local model: V = 3.0 + 1.2 soc + 0.02 I, about the simulated cell around half charge."""
    structure = minimal_structure(dt_s, output_order=1)
    partition = Partition(np.zeros((1, 1)), np.ones((1, 1)), np.array([0.5]))
    scaling = {"voltage": (3.0, 4.2), "soc": (0.0, 1.0), "current": (0.0, 10.0)}
    by_name = {"soc(k-1)": 1.0, "current(k-0)": 0.02 * 10 / 1.2}
    theta = np.array([[by_name.get(name, 0.0) for name in structure.regressor_names()]])
    return LocalModelNetwork(structure, partition, theta, scaling, CellContext(3.0))


async def test_live_observer_is_stored_and_equals_the_replay(lock_step: Rig) -> None:
    network = linear_cell_model(0.1)
    observer = {"model": network.to_json(), "settings": {"initial_soc": 0.4}}
    ended = await lock_step.play(request([0, 30, 60], [2.0, -2.0, 0.0], observer=observer))
    assert ended["state"] == "completed", ended
    columns = stored(lock_step.data_dir)
    with SampleReader(lock_step.data_dir) as reader:
        observed = dict(reader.read("run-1", OBSERVER).columns)
    fuzzy = FuzzyObserver(network)
    _, expected = fuzzy.replay(
        fuzzy.initial(0.4), columns["current_A"], columns["voltage_V"], columns["temperature_degC"]
    )
    assert observed["time_s"].tolist() == columns["time_s"].tolist()
    assert np.array_equal(observed["soc"], expected[:, 0])
    assert np.array_equal(observed["innovation_V"], expected[:, 3])
    assert np.ptp(observed["soc"]) > 0.01
    shown = [live["soc"] for live in lock_step.heard.live if live["run_id"]]
    assert shown and set(shown) <= set(observed["soc"].tolist())


async def test_observer_of_another_period_is_refused(lock_step: Rig) -> None:
    observer = {"model": linear_cell_model(0.5).to_json(), "settings": None}
    ended = await lock_step.play(request([0, 1], [1.0, 0.0], observer=observer))
    assert "the model's period is 0.5 s, the run's 0.1 s" in ended["reason"]


async def test_stop_that_comes_before_the_run_has_begun(lock_step: Rig) -> None:
    lock_step.begin(request([0, 36000], [0.0, 0.0]))
    lock_step.supervisor.stop("changed my mind")
    ended = await lock_step.end_of("run-1")
    assert (ended["state"], ended["reason"]) == ("stopped", "changed my mind")


async def test_ctrl_c_on_the_terminal_reaches_neither_control_nor_recorder(lock_step: Rig) -> None:
    # A terminal signals the group in its foreground; both must hear of the end from the service alone.
    for pid in (lock_step.supervisor.pid, lock_step.recorder.pid):
        assert pid is not None and os.getpgid(pid) == pid != os.getpgrp()


async def test_a_second_master_is_noticed_in_the_middle_of_a_run(wall: Rig) -> None:
    wall.begin(request(*LONG, dt_s=0.05))
    await wall.running(0.2)
    other = open_cycler(wall.simulator.url, "generic", 0.5)
    await other.connect()
    await other._write("watchdog", 60.0)  # pyright: ignore[reportAttributeAccessIssue]
    await other.close()
    ended = await wall.end_of("run-1")
    assert ended["state"] == "fault" and wall.heard.codes("error") == ["second_master"]
    assert "'watchdog' reads 60 s where 1 s was written" in ended["reason"]
    assert not (await wall.reading()).output_on
