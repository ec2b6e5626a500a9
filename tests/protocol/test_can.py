"""What only the CAN driver has: tokens, echoes, refusals, cyclic messages, maps with long frames."""

import asyncio
import time

import pytest

from drivers.can_codec import CanCodec
from drivers.cycler import (
    CyclerConnectionError,
    CyclerProtocolError,
    CyclerTimeoutError,
    SetPointRefusedError,
)
from drivers.factory import open_cycler
from drivers.register_map import load_can_map
from simulators.can_bus import CanAction
from tests.patience import holds
from tests.protocol.can_hooks import on
from tests.protocol.rigs import PATIENT_S, TIMEOUT_S, rig

MAP = load_can_map("generic_can")

VOLTAGE, SETPOINT = "Electrical", "Command"


async def test_silence_is_a_time_out_and_ends_in_rest(made):
    await made.running()
    made.server.on_frame = on("Request", CanAction(execute=False))
    started_s = time.monotonic()
    told = r"no answer 'Condition', 'Electrical', 'State' within 0\.25 s"
    with made.impatient(), pytest.raises(CyclerTimeoutError, match=told):
        await made.driver.sample()
    assert TIMEOUT_S <= time.monotonic() - started_s < PATIENT_S / 2
    with pytest.raises(CyclerConnectionError, match="not connected"):
        await made.driver.sample()
    await made.driver.safe()
    assert made.at_rest
    with pytest.raises(CyclerProtocolError, match="acquire first"):  # reconnecting never resumes
        await made.driver.apply(1.0)


async def test_one_frame_of_an_answer_lost(made):
    await made.running()
    made.server.on_frame = on("Request", CanAction(change=lambda name, data: None if name == "State" else data))
    with made.impatient(), pytest.raises(CyclerTimeoutError, match="no answer 'State' within"):
        await made.driver.sample()


async def test_a_late_answer_is_known_by_its_token(made):
    await made.running()
    link = made.driver._link
    codec, plan = CanCodec(MAP.dbc), made.driver._dialogue.plan
    first = plan.frame(MAP.asks["sample"].send, {"token": 200.0})
    late, heard = on("Request", CanAction(delay_s=0.1)), []
    made.server.on_frame = lambda name, raws: (heard.append(name), late(name, raws))[1]
    await link.exchange("Request", first, (), "a question whose answer nobody waits for")
    await holds(lambda: heard, "the device has the question")
    voltage = made.device.cycler.measurement.voltage_V
    made.device.cycler.measurement = made.device.cycler.measurement._replace(voltage_V=1.0)
    reading = await made.driver.sample()
    await holds(lambda: link.newest[VOLTAGE][0] > reading.monotonic_s, "the late answer, with the old voltage, is in")
    assert reading.voltage_V == 1.0 and link.newest[VOLTAGE][0] > reading.monotonic_s
    assert codec.physical(VOLTAGE, codec.raw(VOLTAGE, link.newest[VOLTAGE][1]))["Voltage"] == pytest.approx(voltage)
    assert (await made.driver.sample()).voltage_V == 1.0


async def test_an_echo_that_differs(made):
    await made.running()
    made.server.on_frame = on(SETPOINT, CanAction(change=lambda _, data: bytes(3) + data[3:]))
    with pytest.raises(SetPointRefusedError, match=r"'setpoint': SetCurrent was sent as 3, the device repeats 0"):
        await made.driver.apply(3.0)


async def test_a_refusal_is_told_with_its_reason(made):
    await made.running()
    with pytest.raises(SetPointRefusedError, match=r"refused with code 3 \(value out of range\)"):
        await made.driver.apply(11.0)  # beyond the limit in the device


async def test_answers_under_another_identifier_are_not_heard(made):
    await made.running()
    made.server.on_frame = on("Request", CanAction(shift=0x200))
    with made.impatient(), pytest.raises(CyclerTimeoutError):
        await made.driver.sample()


async def test_a_frame_that_is_too_short(made):
    await made.running()
    made.server.on_frame = on("Request", CanAction(change=lambda name, data: data[:3] if name == "State" else data))
    with made.impatient(), pytest.raises((CyclerProtocolError, CyclerTimeoutError)):
        await made.driver.sample()
    await made.driver.safe()
    assert made.at_rest


def cyclic_map(tmp_path):
    """The generic map with its sample sent by the device unasked."""
    text = MAP.file.read_text().replace('"generic_can.dbc"', f'"{MAP.dbc}"')
    start, end = text.index("[ask.sample]"), text.index("# Commands;")
    path = tmp_path / "cyclic.toml"
    path.write_text(text[:start] + text[end:])
    return path


async def test_cyclic_messages_have_an_age(tmp_path):
    async with rig("can-virtual", lock_step=False) as made:
        driver = open_cycler(made.address, cyclic_map(tmp_path), TIMEOUT_S)
        await driver.connect()
        with pytest.raises(CyclerTimeoutError, match="has not come yet"):
            await driver.sample()
        device, node = made.device, made.server
        for name in ("Electrical", "Condition", "State"):
            node._port.send(device.layouts[name].id, device.message(name), extended=False)
        await holds(lambda: driver._link.newest.keys() >= {"Electrical", "Condition", "State"}, "all have come")
        assert (await driver.sample()).voltage_V > 3.0
        await asyncio.sleep(0.5)
        with pytest.raises(CyclerTimeoutError, match=r"cyclic message '\w+' last came .* limit 0.5 s"):
            await driver.sample()
        await driver.close()


FD_DBC = """\
VERSION ""
BU_: Bench Cycler
BO_ 2566848512 Tell: 4 Bench
 SG_ Charge : 0|16@1+ (0.01,0) [0|655.35] "A" Cycler
 SG_ Discharge : 16|16@1+ (0.01,0) [0|655.35] "A" Cycler
BO_ 2566848513 Switch: 1 Bench
 SG_ On : 0|1@1+ (1,0) [0|1] "" Cycler
BO_ 2566848514 Ask: 1 Bench
 SG_ What : 0|8@1+ (1,0) [0|255] "" Cycler
BO_ 2566848515 Everything: 16 Cycler
 SG_ Class : 0|16@1+ (1,0) [0|65535] "" Bench
 SG_ Volts : 16|16@1+ (0.001,0) [0|65.535] "V" Bench
 SG_ Amps : 32|16@1+ (0.01,0) [0|655.35] "A" Bench
 SG_ Sinking : 48|1@1+ (1,0) [0|1] "" Bench
 SG_ Running : 49|1@1+ (1,0) [0|1] "" Bench
 SG_ Celsius : 64|16@1- (0.1,0) [-50|150] "degC" Bench
 SG_ Count : 96|32@1+ (1,0) [0|4294967295] "" Bench
"""

FD_MAP = """\
schema = 1
name = "made_up"
title = "Made-up"
source = "this test"
verified_on_hardware = false
transport = "can"
dbc = "made_up.dbc"
fd = true
worst_reply_s = 0.05
positive_current = "charge"
identity = { signal = "Everything.Class", equals = 77 }
capabilities = { current = ["-20", "20"], voltage = ["0", "6"], watchdog = ["0.1", "10"] }
ask.all = { send = "Ask", values = { What = 1 }, replies = ["Everything"] }
command.tell = { send = "Tell", values = { Charge = "charge", Discharge = "discharge" } }
command.switch = { send = "Switch", values = { On = "output" } }
role.actual_voltage = { signal = "Everything.Volts" }
role.actual_current = { signal = "Everything.Amps", negative = "Everything.Sinking" }
role.temperature = { signal = "Everything.Celsius" }
role.sequence = { signal = "Everything.Count" }
status = { output_on = "Everything.Running" }
sequence.tick = [{ command = "tell" }]
sequence.output = [{ command = "switch" }]
sequence.safe = [{ command = "switch", output = false }]
"""


async def test_a_made_up_cycler_with_long_frames_and_two_set_points_is_one_map(tmp_path):
    """CAN FD, extended identifiers, unsigned values, no echo: nothing of it needs a line of code."""
    (tmp_path / "made_up.dbc").write_text(FD_DBC)
    path = tmp_path / "made_up.toml"
    path.write_text(FD_MAP)
    async with rig("can-virtual", lock_step=False, map_name=str(path)) as made:
        able = await made.driver.connect()
        assert able.current_A == (-20.0, 20.0) and able.watchdog_s == (0.1, 10.0) and able.has_sequence
        await made.running(4.0)
        for current_A in (-2.5, 4.0):
            await made.driver.apply(current_A)
            await asyncio.sleep(0.05)
            reading = await made.driver.sample()
            assert reading.current_A == pytest.approx(current_A, abs=0.02) and reading.output_on
            assert reading.temperature_degC == pytest.approx(25.0, abs=0.2)
        await made.driver.safe()
        assert made.at_rest
