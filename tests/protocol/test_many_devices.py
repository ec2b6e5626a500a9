"""Several cyclers, or several channels of one, at one address; a module in place of a cell."""

import asyncio
import json
import os
import sys

import pytest

from bench_service.cli.main import main
from drivers.cycler import DeviceLimits
from drivers.factory import open_cycler
from tests.patience import PATIENCE_S

LIMITS = DeviceLimits((2.5, 4.25), (-10.0, 10.0), (-10.0, 60.0), None)


async def simulator(*arguments):
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "bench_service.cli", "simulate", "--lock-step", "--json", *arguments,
        stdout=asyncio.subprocess.PIPE, env=dict(os.environ),
    )  # fmt: skip
    return process, json.loads(await asyncio.wait_for(process.stdout.readline(), PATIENCE_S))["address"]


async def ended(process):
    process.terminate()
    assert await asyncio.wait_for(process.wait(), PATIENCE_S) == 0


@pytest.mark.parametrize(
    ("protocol", "numbers"),
    [
        ("modbus-tcp", ("?unit=1", "?unit=3")),
        ("modbus-rtu", ("&unit=1", "&unit=3")),
        ("can", ("?node=0", "?node=2")),
    ],
)
async def test_each_device_of_an_address_lives_for_itself(protocol, numbers):
    process, address = await simulator("--protocol", protocol, "--devices", "3", "--baud", "921600")
    base = address.partition("?")[0] if protocol == "can" else address
    drivers = [open_cycler(base + number, "generic_can" if protocol == "can" else "generic", 0.3) for number in numbers]
    seen = []
    for driver, current_A in zip(drivers, (2.0, -3.0), strict=True):
        await driver.connect()
        await driver.acquire(LIMITS, 1.0, 0.1)
        await driver.output(True)
        await driver.sample()
        await driver.apply(current_A)
        seen.append(await driver.sample())
        if protocol == "modbus-rtu":
            await driver.close()  # one program at a time has a serial line
    assert [reading.setpoint_in_force_A for reading in seen] == [2.0, -3.0]
    assert [reading.sequence for reading in seen] == [1, 1]
    for driver in drivers:
        await driver.safe()
        await driver.close()
    await ended(process)


async def test_a_module():
    process, address = await simulator("--module", "4x2", "--cell", "lfp")
    driver = open_cycler(address, "generic", 0.3)
    able = await driver.connect()
    assert able.current_A == (-60.0, 60.0) and able.voltage_V == (0.0, 24.0)
    assert (await driver.sample()).voltage_V == pytest.approx(4 * 3.3, abs=0.3)
    await driver.close()
    await ended(process)


@pytest.mark.parametrize(("option", "value"), [("--module", "four"), ("--devices", "0"), ("--faults", "storm@t:1")])
def test_what_cannot_be_simulated(option, value, capsys):
    assert main(["simulate", option, value]) == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1 and not said.out
