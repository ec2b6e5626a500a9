"""The emulated battery over Modbus TCP and CAN: current in, voltage and BMS frames out, in real time."""

import asyncio
import itertools
import json
import os
import struct
import sys
import time
import uuid

import can
import cantools
import pytest
from pymodbus.client import AsyncModbusTcpClient

from drivers.register_map import MAPS
from simulators.can_bus import CanBusSettings
from simulators.catalogue import cell_type
from simulators.cell import Cell
from simulators.emulator import Battery, EmulatorSettings, PaceReport, _run, serve_battery
from tests.patience import PATIENCE_S
from tests.unit.models import hand_network

DATABASE = cantools.database.load_file(MAPS / "emulated_bms.dbc")


def nmc():
    return Cell(cell_type("nmc").parameters, 0.5, 25.0)


def f32(registers):
    return struct.unpack(f">{len(registers) // 2}f", struct.pack(f">{len(registers)}H", *registers))


async def started(settings):
    """Serve a battery as a task; return it and the address."""
    ready = asyncio.get_running_loop().create_future()
    task = asyncio.create_task(serve_battery(nmc(), settings, ready.set_result))
    return task, await asyncio.wait_for(ready, PATIENCE_S)


async def test_over_modbus_tcp():
    task, address = await started(EmulatorSettings(seconds=2.0))
    client = AsyncModbusTcpClient("127.0.0.1", port=int(address.rsplit(":", 1)[1]))
    await client.connect()
    rest = f32((await client.read_holding_registers(10, count=6, device_id=1)).registers)
    assert rest[0] == pytest.approx(3.7, abs=0.1) and rest[1:] == pytest.approx((25.0, 0.5), abs=1e-3)
    before_s = time.monotonic()
    before = (await client.read_holding_registers(16, count=3, device_id=1)).registers
    assert before[2] & 1, "nobody has told a current yet"
    assert not (
        await client.write_registers(0, list(struct.unpack(">2H", struct.pack(">f", 5.0))), device_id=1)
    ).isError()
    await asyncio.sleep(0.3)
    reply = (await client.read_holding_registers(10, count=9, device_id=1)).registers
    passed_s = time.monotonic() - before_s
    assert f32(reply[:2])[0] > rest[0] + 0.02
    assert not reply[8] & 1
    assert 20 <= (reply[6] << 16 | reply[7]) - (before[0] << 16 | before[1]) <= 100 * passed_s + 5
    for first, words in ((0, [0x7FC0, 0]), (10, [0, 0]), (0, [1])):
        assert (await client.write_registers(first, words, device_id=1)).isError()
    client.close()
    pace = await task
    assert pace.ticks + pace.missed == 200


async def test_a_last_tick_that_comes_late_does_not_count_past_the_end():
    pace = PaceReport()

    class Late:
        """A clock that wakes up 80 ms late, eight ticks, every time."""

        async def until(self, due_s):
            await asyncio.sleep(max(0.0, due_s + 0.08 - time.monotonic()))

    await _run(Battery(nmc()), EmulatorSettings(seconds=0.2), lambda: None, Late(), pace)
    assert pace.ticks + pace.missed == 20
    assert pace.missed >= 16


async def test_over_can():
    bus_settings = CanBusSettings(interface="virtual", channel=uuid.uuid4().hex)
    task, _ = await started(EmulatorSettings(protocol="can", can=bus_settings, seconds=1.0, cells_in_series=2))
    with can.Bus(interface="virtual", channel=bus_settings.channel, protocol=can.CanProtocol.CAN_20) as bus:
        seen = []
        for k in itertools.count():
            data = DATABASE.encode_message("PowerCurrent", {"Current": -5.0, "Counter": k})
            bus.send(can.Message(arbitration_id=0x310, data=data, is_extended_id=False))
            await asyncio.sleep(0.01)
            while (message := bus.recv(0)) is not None:
                seen.append((message.arbitration_id, DATABASE.decode_message(message.arbitration_id, message.data)))
            if task.done() or sum(identifier == 0x300 for identifier, _ in seen) > 35:
                break
    await task
    electrical = [values for identifier, values in seen if identifier == 0x300]
    state = [values for identifier, values in seen if identifier == 0x301]
    assert len(electrical) > 25
    assert electrical[-1]["Current"] == -5.0 and electrical[-1]["Voltage"] < electrical[0]["Voltage"]
    assert state[-1]["CellVoltage"] == pytest.approx(electrical[-1]["Voltage"] / 2, abs=2e-3)
    assert not state[-1]["InputStale"] and state[-1]["Sequence"] > state[0]["Sequence"]


def test_a_current_that_is_not_told_any_more_is_zero():
    now = [0.0]
    battery = Battery(nmc(), lambda: now[0])
    battery.tell(3.0)
    assert battery.current_A == 3.0
    now[0] = 1.1
    assert battery.stale and battery.current_A == 0.0
    with pytest.raises(ValueError, match="no finite number"):
        battery.tell(float("nan"))


@pytest.mark.parametrize("settings", [{"protocol": "modbus-rtu"}, {"rate_Hz": 0.5}, {"rate_Hz": 1e4}])
def test_bad_settings(settings):
    with pytest.raises(ValueError, match="choose modbus-tcp or can|must lie in"):
        EmulatorSettings(**settings)


async def test_an_identified_model_is_served_by_the_command(tmp_path):
    model, module = tmp_path / "model.json", tmp_path / "module.json"
    model.write_text(json.dumps(hand_network.everything(1).to_json()))
    from models.module.models import ModuleModel

    module.write_text(json.dumps(ModuleModel("S1", 3, 1).to_json()))
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "bench_service.cli", "emulate", str(model), "--module", str(module), "--seconds", "1.5",
        "--initial-soc", "0.55", "--json", stdout=asyncio.subprocess.PIPE, env=dict(os.environ),
    )  # fmt: skip
    address = json.loads(await asyncio.wait_for(process.stdout.readline(), PATIENCE_S))["address"]
    client = AsyncModbusTcpClient("127.0.0.1", port=int(address.rsplit(":", 1)[1]))
    await client.connect()
    (volts,) = f32((await client.read_holding_registers(10, count=2, device_id=1)).registers)
    client.close()
    assert volts == pytest.approx(3 * 3.5, abs=2.0)
    assert await asyncio.wait_for(process.wait(), PATIENCE_S) == 0
