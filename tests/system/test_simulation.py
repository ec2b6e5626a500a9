"""The service's own simulators end with it, and a little after it when it dies."""

import asyncio
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bench_service.simulation import SimulationError, SimulatorProcess
from drivers.factory import open_cycler
from tests.patience import PATIENCE_S, holds

_DYING_SERVICE = """
import asyncio, os, signal
from bench_service.simulation import SimulatorProcess
async def main():
    simulator = await SimulatorProcess.start(["--lock-step"])
    print(simulator.pid, simulator.address, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
asyncio.run(main())
"""


async def test_a_simulator_answers_until_it_is_stopped() -> None:
    simulator = await SimulatorProcess.start(["--lock-step", "--cell", "lfp"])
    cycler = open_cycler(simulator.address, "generic", 0.5)
    assert (await cycler.connect()).lock_step
    await cycler.close()
    await simulator.stop()
    await simulator.wait()
    await simulator.stop()
    with pytest.raises(ConnectionRefusedError):
        await asyncio.open_connection("127.0.0.1", int(simulator.address.rsplit(":", 1)[1]))


async def test_a_simulator_that_cannot_start_says_why() -> None:
    with pytest.raises(SimulationError, match="did not start: error: .*cell"):
        await SimulatorProcess.start(["--cell", "cake"])


async def test_a_dead_service_leaves_its_simulator_for_a_moment() -> None:
    dead = subprocess.run([sys.executable, "-c", _DYING_SERVICE], stdout=subprocess.PIPE, text=True, timeout=PATIENCE_S)
    assert dead.returncode == -signal.SIGKILL
    pid, address = dead.stdout.split()
    # The control process of the dead service can still bring it to rest.
    cycler = open_cycler(address, "generic", 0.5)
    await cycler.connect()
    await cycler.close()
    os.kill(int(pid), signal.SIGTERM)
    await holds(lambda: not Path(f"/proc/{pid}").exists(), "the simulator has ended")
    with pytest.raises(ConnectionRefusedError):
        await asyncio.open_connection("127.0.0.1", int(address.rsplit(":", 1)[1]))
