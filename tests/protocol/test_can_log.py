"""The traffic of a run as a file, and what another program makes of it."""

import subprocess
import sys

import can
import cantools
import pytest

from drivers.can_log import TrafficLog
from drivers.register_map import load_can_map
from tests.patience import PATIENCE_S
from tests.protocol.rigs import LIMITS

MAP = load_can_map("generic_can")


@pytest.mark.parametrize("suffix", ["", ".asc", ".log"])
async def test_the_traffic_of_a_run_is_logged(made, tmp_path, suffix):
    folder = tmp_path / f"traffic{suffix}"
    driver = made.another(f"&log={folder}")
    await driver.connect()
    for _ in range(2):  # each run has a file of its own
        await driver.acquire(LIMITS, 1.0, 0.1)
        await driver.output(True)
        wanted = []
        for current_A in (1.0, -2.5):
            await driver.apply(current_A)
            wanted.append((await driver.sample()).voltage_V)
        await driver.safe()
        await driver.release()
    await driver.close()
    first, second = sorted(folder.iterdir())
    database = cantools.database.load_file(MAP.dbc)
    seen = {"Command": [], "Electrical": []}
    with can.LogReader(second) as log:
        for message in log:
            name = database.get_message_by_frame_id(message.arbitration_id).name
            seen.setdefault(name, []).append(database.decode_message(name, message.data))
    assert [round(values["SetCurrent"], 4) for values in seen["Command"]][-2:] == [1.0, -2.5]
    voltages = [values["Voltage"] for values in seen["Electrical"]]
    assert all(voltage in voltages for voltage in wanted)
    assert first.stat().st_size > 0


async def test_another_program_decodes_the_traffic_to_the_same_values(made, tmp_path):
    """The decoder of cantools' command line reads the candump form of the log."""
    driver = made.another(f"&log={tmp_path / 'traffic.log'}")
    await driver.connect()
    await driver.acquire(LIMITS, 1.0, 0.1)
    await driver.output(True)
    await driver.apply(-2.5)
    reading = await driver.sample()
    await driver.safe()
    await driver.close()
    (path,) = (tmp_path / "traffic.log").iterdir()
    done = subprocess.run(
        [sys.executable, "-m", "cantools", "decode", "--single-line", str(MAP.dbc)],
        input=path.read_text(), capture_output=True, text=True, check=True, timeout=PATIENCE_S,
    )  # fmt: skip
    assert f"Voltage: {reading.voltage_V:.4f} V".replace("0 V", " V") in done.stdout.replace("0 V", " V")
    assert "SetCurrent: -2.5 A" in done.stdout and "OutputOn: 1" in done.stdout


async def test_a_log_that_cannot_be_written_does_not_stop_a_run(made, tmp_path, caplog):
    (tmp_path / "file").write_text("")
    driver = made.another(f"&log={tmp_path / 'file' / 'x'}")
    await driver.connect()
    await driver.acquire(LIMITS, 1.0, 0.1)
    assert "CAN traffic is not logged" in caplog.text
    await driver.close()


@pytest.mark.parametrize("channel", ["can1", "a22722979", "no number", None])
@pytest.mark.parametrize("suffix", ["", ".asc"])
def test_a_channel_of_any_name_is_logged(tmp_path, channel, suffix):
    log = TrafficLog(str(tmp_path / f"traffic{suffix}"), "bench")
    path = log.start()
    log.put(can.Message(arbitration_id=0x123, data=[1, 2], is_extended_id=False, channel=channel, timestamp=1.0))
    log.stop()
    with can.LogReader(path) as frames:
        (found,) = frames
    assert (found.arbitration_id, bytes(found.data)) == (0x123, b"\x01\x02")
    assert found.channel == (1 if channel == "can1" else 0)
