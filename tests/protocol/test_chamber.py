"""The driver of a temperature chamber against the simulated one, over real Modbus TCP."""

import asyncio
import contextlib
import math
import struct
from collections.abc import AsyncIterator
from dataclasses import dataclass

import pytest

from drivers.cycler import CyclerConnectionError, CyclerProtocolError, CyclerTimeoutError, SetPointRefusedError
from drivers.errors import BadMapError
from drivers.factory import open_chamber, open_cycler
from drivers.map_frames import check_frames
from drivers.modbus_chamber import ModbusChamber
from drivers.register_map import MAPS, list_maps, load_map
from simulators.chamber import Chamber, ChamberSettings
from simulators.chamber_device import ChamberDevice
from simulators.chamber_server import chamber_beside
from simulators.modbus_actions import SILENCE
from simulators.modbus_server import ModbusServer
from tests.protocol.rigs import PATIENT_S

maps = pytest.mark.parametrize("name", list_maps(kind="chamber"))


@dataclass
class Rig:
    device: ChamberDevice
    server: ModbusServer
    url: str
    driver: ModbusChamber


@contextlib.asynccontextmanager
async def rig(name: str = "generic_chamber", *, timeout_s: float = PATIENT_S) -> AsyncIterator[Rig]:
    device, server = chamber_beside(Chamber(ChamberSettings(map_name=name), 24.5), lambda: None)
    url = f"modbus-tcp://127.0.0.1:{await server.start('127.0.0.1', 0)}"
    driver = open_chamber(url, name, timeout_s)
    assert isinstance(driver, ModbusChamber)
    try:
        yield Rig(device, server, url, driver)
    finally:
        await driver.close()
        await server.close()


@maps
async def test_a_whole_life(name: str) -> None:
    async with rig(name) as made:
        identity = await made.driver.connect()
        assert set(identity.said) == {"maker", "model", "serial", "firmware"} and identity.said["serial"] == "1"
        low, high = identity.range_degC
        seen = await made.driver.sample()
        assert (seen.temperature_degC, seen.on, seen.alarms) == (24.5, False, frozenset())
        await made.driver.set(-10.5)
        seen = await made.driver.sample()
        assert made.device.chamber.set_degC == -10.5 and (seen.setpoint_degC, seen.on) == (-10.5, True)
        for impossible in (math.nan, low - 1.0, high + 1.0):
            with pytest.raises(SetPointRefusedError, match="not sent"):
                await made.driver.set(impossible)
        await made.driver.standby()
        assert not made.device.chamber.on and not (await made.driver.sample()).on
        await made.driver.close()
        with pytest.raises(CyclerConnectionError):
            await made.driver.sample()


@maps
def test_its_map_holds_and_its_frames_mean_what_they_say(name: str) -> None:
    device_map = load_map(name, "chamber")
    assert check_frames(device_map) == len(device_map.frames) > 0
    functions = {frame.request[0] for frame in device_map.frames}
    assert functions & {3, 4} and functions & {5, 6, 16}


def test_the_generic_frames_were_computed_by_hand() -> None:
    read, write, _ = load_map("generic_chamber", "chamber").frames
    assert read.reply == struct.pack(">BBHHHH", 3, 8, 3500, 2487, 1, 0)
    assert write.request == struct.pack(">BHh", 6, 100, -1050)


async def test_missing_air_alarms_and_other_devices_are_told_from_values() -> None:
    async with rig() as made:
        await made.driver.connect()
        made.device.chamber.air_degC = math.nan
        made.device.chamber.alarms |= {"fan", "over_temperature"}
        seen = await made.driver.sample()
        assert math.isnan(seen.temperature_degC) and seen.alarms == {"fan", "over_temperature"}
        with pytest.raises(CyclerProtocolError, match=r"switched on, but its status says otherwise.*fan"):
            await made.driver.set(30.0)
        await made.driver.clear_fault()
        assert not (await made.driver.sample()).alarms
        made.device.chamber.set = lambda temperature_degC: None
        with pytest.raises(SetPointRefusedError, match=r"31 degC was written, 30\.0 degC stands there"):
            await made.driver.set(31.0)
        other = open_cycler(made.url, "generic", PATIENT_S)
        with pytest.raises(CyclerProtocolError, match="another device, or the wrong map; nothing was written"):
            await other.connect()
        await asyncio.sleep(0)  # its socket is closed by the loop


async def test_silence_is_told_and_the_link_given_up() -> None:
    async with rig(timeout_s=0.1) as made:
        driver = made.driver
        await driver.connect()
        made.server.on_request = lambda frame: SILENCE
        with pytest.raises(CyclerTimeoutError, match=r"no answer within 0\.1 s"):
            await driver.sample()
        made.server.on_request = None
        with pytest.raises(CyclerConnectionError):
            await driver.sample()
        await driver.connect()
        assert (await driver.sample()).temperature_degC == 24.5


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('role = "temperature" ', 'role = "alarms" #', "role 'alarms' is given to 2"),
        ('role = "set_temperature"', "", "no register has the role 'set_temperature', which every chamber needs"),
        ('access = "rw"\nrole = "set_temperature"', 'access = "w"\nrole = "set_temperature"', "needs access 'r'"),
        ("output_on = 0", "door = 0", "needs a bit 'output_on'"),
        ("value = false", "value = true", "safe means output off"),
        ('temperature = ["-70", "180"]', 'current = ["-1", "1"]', "capabilities.current: is not a known key"),
        ('kind = "chamber"', 'kind = "oven"', "kind: must be one of"),
    ],
)
def test_what_is_no_map_of_a_chamber_is_refused(tmp_path, old: str, new: str, told: str) -> None:
    text = (MAPS / "generic_chamber.toml").read_text()
    assert old in text
    (tmp_path / "x.toml").write_text(text.replace(old, new, 1))
    with pytest.raises(BadMapError, match=told):
        load_map(tmp_path / "x.toml", "chamber")


def test_the_two_kinds_of_maps_are_not_mistaken_for_each_other() -> None:
    with pytest.raises(BadMapError, match="is 'chamber'; the map of a cycler is needed"):
        open_cycler("modbus-tcp://h:1", "generic_chamber", 1.0)
    with pytest.raises(BadMapError, match="is 'cycler'; the map of a chamber is needed"):
        open_chamber("modbus-tcp://h:1", "generic", 1.0)
    with pytest.raises(CyclerConnectionError, match="a chamber is reached over"):
        open_chamber("can://socketcan/can0", "generic_chamber", 1.0)
    with pytest.raises(CyclerConnectionError, match="time-out must be positive"):
        open_chamber("modbus-tcp://h:1", "generic_chamber", 0.0)
    assert "generic_chamber" not in list_maps() and list_maps(kind="chamber") == ("generic_chamber",)
