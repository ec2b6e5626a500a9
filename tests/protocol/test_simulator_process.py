"""The simulator as a whole: start, end, bad settings, and an independent client (libmodbus)."""

import asyncio
import os
import signal
import subprocess
import sys

import pytest

from simulators.bench import SimulatorError, SimulatorSettings, build_device, serve
from tests.patience import PATIENCE_S, holds
from tests.protocol.raw_modbus import Client, rig, switch_on, until_moved


async def test_serve_reports_its_address_and_ends_with_the_output_off() -> None:
    addresses: list[str] = []
    task = asyncio.create_task(serve(SimulatorSettings(), addresses.append))
    await holds(lambda: addresses, "an address")
    assert addresses[0].startswith("modbus-tcp://127.0.0.1:")
    port = int(addresses[0].rsplit(":", 1)[1])
    client = Client(*await asyncio.open_connection("127.0.0.1", port))
    await switch_on(client)
    first = await client.sample()
    await until_moved(client, first["sequence"])
    with pytest.raises(SimulatorError, match=f"127.0.0.1:{port}.*choose another port"):
        await serve(SimulatorSettings(port=port), addresses.append)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    async with asyncio.timeout(PATIENCE_S):
        assert await client.reader.read() == b""
    client.writer.close()


def test_sigterm_ends_cleanly() -> None:
    program = (
        "import asyncio\n"
        "from simulators.bench import SimulatorSettings, serve\n"
        "asyncio.run(serve(SimulatorSettings(), lambda address: print(address, flush=True)))\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("modbus-tcp://")
        os.kill(process.pid, signal.SIGTERM)
        assert process.wait(timeout=PATIENCE_S) == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"protocol": "carrier-pigeon"}, "choose one of modbus-tcp"),
        ({"speed": 0.0}, "speed is 0.0"),
        ({"port": 70000}, "port is 70000"),
        ({"cell": "lead"}, "unknown cell 'lead'"),
        ({"effects": {"magic": 1.0}}, "unknown effect 'magic'"),
        ({"capacity_Ah": -1.0}, "capacity_Ah is -1"),
        ({"initial_soc": 2.0}, r"must lie in 0\.\.1"),
    ],
)
def test_bad_settings_say_what_is_wrong(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build_device(SimulatorSettings(**options))  # pyright: ignore[reportArgumentType]


async def mbpoll(port: int, *arguments: str) -> str:
    process = await asyncio.create_subprocess_exec(
        "mbpoll", "-1", "-0", "-B", "-p", str(port), *arguments, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    output, _ = await asyncio.wait_for(process.communicate(), PATIENCE_S)
    assert process.returncode == 0, output.decode()
    return output.decode()


@pytest.mark.needs_program("mbpoll")
async def test_libmodbus_reads_and_writes_the_simulator() -> None:
    async with rig() as r:
        shown = await mbpoll(r.port, "-t", "4:float", "-r", "2", "-c", "2", "127.0.0.1")
        assert "[2]: \t30" in shown
        assert "[4]: \t6" in shown
        shown = await mbpoll(r.port, "-t", "4:hex", "-r", "0", "-c", "2", "127.0.0.1")
        assert "[0]: \t0x4254" in shown
        await mbpoll(r.port, "-t", "0", "-r", "0", "127.0.0.1", "1", "1")  # remote and output, FC 15
        shown = await mbpoll(r.port, "-t", "0", "-r", "0", "-c", "3", "127.0.0.1")
        assert "[0]: \t1" in shown
        assert "[1]: \t1" in shown
        await mbpoll(r.port, "-t", "4:float", "-r", "100", "127.0.0.1", "2.5")  # FC 16
        await mbpoll(r.port, "-t", "4", "-r", "102", "127.0.0.1", "77")  # FC 6
        await mbpoll(r.port, "-t", "4:int", "-r", "103", "127.0.0.1", "1")
        sample = await r.client.sample()
        assert (sample["sequence"], sample["setpoint_A"]) == (1, 2.5)
        shown = await mbpoll(r.port, "-t", "4:float", "-r", "208", "127.0.0.1")
        assert "[208]: \t2.5" in shown
