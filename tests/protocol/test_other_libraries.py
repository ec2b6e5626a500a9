"""Both ends against libmodbus: its client (mbpoll) at our simulator, its server at our driver, over TCP and RTU."""

import asyncio
import contextlib
import ctypes.util
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.factory import open_cycler
from tests.patience import PATIENCE_S, holds
from tests.protocol.rigs import LIMITS, rig

LIBMODBUS = ctypes.util.find_library("modbus") or "libmodbus.so.5"  # mbpoll brings it

# A plain libmodbus server whose registers are memory, filled like those of the generic map.
SERVER = """
import ctypes, socket, struct, sys
from tests.patience import PATIENCE_S
lib = ctypes.CDLL(sys.argv[1], use_errno=True)
class Mapping(ctypes.Structure):
    _fields_ = [(name, ctypes.c_int) for name in ("nb_bits", "start_bits", "nb_input_bits", "start_input_bits",
                "nb_input_registers", "start_input_registers", "nb_registers", "start_registers")] + [
                ("bits", ctypes.POINTER(ctypes.c_uint8)), ("input_bits", ctypes.POINTER(ctypes.c_uint8)),
                ("input_registers", ctypes.POINTER(ctypes.c_uint16)), ("registers", ctypes.POINTER(ctypes.c_uint16))]
for name in ("modbus_new_tcp", "modbus_new_rtu"):
    getattr(lib, name).restype = ctypes.c_void_p
lib.modbus_mapping_new.restype = ctypes.POINTER(Mapping)
mapping = lib.modbus_mapping_new(8, 0, 256, 0)
def put(address, layout, value):
    data = struct.pack(">" + layout, value)
    for i in range(0, len(data), 2):
        mapping.contents.registers[address + i // 2] = int.from_bytes(data[i:i + 2], "big")
put(0, "H", 0x4254); put(2, "f", 30.0); put(4, "f", 6.0); put(6, "I", 4711)
put(200, "I", 7); put(202, "f", 3.7); put(204, "f", -12.5); put(206, "h", 2531); put(207, "H", 0x8000)
query = ctypes.create_string_buffer(512)
if sys.argv[2] == "tcp":
    context = ctypes.c_void_p(lib.modbus_new_tcp(b"127.0.0.1", int(sys.argv[3])))
    listening = ctypes.c_int(lib.modbus_tcp_listen(context, 1))
    print("ready", flush=True)
    lib.modbus_tcp_accept(context, ctypes.byref(listening))
else:
    context = ctypes.c_void_p(lib.modbus_new_rtu(sys.argv[3].encode(), 115200, ctypes.c_char(b"N"), 8, 1))
    lib.modbus_set_slave(context, 1)
    assert lib.modbus_connect(context) == 0
    print("ready", flush=True)
while True:
    size = lib.modbus_receive(context, query)
    if size > 0:
        lib.modbus_reply(context, query, size, mapping)
    elif size < 0 and sys.argv[2] == "tcp":
        break
"""


@contextlib.contextmanager
def ended(process):
    """End a child whatever happens, and close its pipes."""
    try:
        yield process
    finally:
        process.terminate()
        process.wait(PATIENCE_S)
        if process.stdout:
            process.stdout.close()


def libmodbus_server(*arguments):
    process = subprocess.Popen([sys.executable, "-c", SERVER, LIBMODBUS, *arguments], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    return process


async def mbpoll_rtu(port, *arguments):
    process = await asyncio.create_subprocess_exec(
        "mbpoll", "-1", "-0", "-B", "-m", "rtu", "-b", "115200", "-P", "none", "-a", "1", *arguments, port,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    output, _ = await asyncio.wait_for(process.communicate(), PATIENCE_S)
    return output.decode()


@pytest.mark.needs_program("mbpoll")
async def test_libmodbus_reads_and_writes_the_simulator_over_rtu():
    async with rig("modbus-rtu") as made:
        port = made.server._line.device
        made.device.cycler.set_remote(True)
        made.device.publish()
        assert "[2]: \t30" in await mbpoll_rtu(port, "-t", "4:float", "-r", "2", "-c", "2")
        assert "[0]: \t0x4254" in await mbpoll_rtu(port, "-t", "4:hex", "-r", "0", "-c", "2")
        written = await asyncio.create_subprocess_exec(
            "mbpoll", "-1", "-0", "-B", "-m", "rtu", "-b", "115200", "-P", "none", "-a", "1",
            "-t", "4:float", "-r", "100", port, "2.5", stdout=subprocess.DEVNULL,
        )  # fmt: skip
        assert await asyncio.wait_for(written.wait(), PATIENCE_S) == 0
        assert made.device.cycler.requested_A == 2.5
        assert "[100]: \t2.5" in await mbpoll_rtu(port, "-t", "4:float", "-r", "100", "-c", "1")


async def _against_libmodbus(url):
    driver = open_cycler(url, "generic", 0.5)
    able = await driver.connect()
    assert able.current_A == (-30.0, 30.0) and able.serial == "4711" and not able.lock_step
    await driver.acquire(LIMITS, 1.0, None)
    reading = await driver.sample()
    assert (reading.sequence, reading.current_A, reading.temperature_degC) == (7, -12.5, 25.31)
    assert reading.voltage_V == pytest.approx(3.7, abs=1e-6)
    assert reading.ambient_degC != reading.ambient_degC
    await driver.apply(-2.5)
    await driver.safe()
    await driver.close()


@pytest.mark.needs_program("mbpoll")
async def test_the_driver_reads_a_libmodbus_server_over_tcp(unused_tcp_port):
    with ended(libmodbus_server("tcp", str(unused_tcp_port))):
        await _against_libmodbus(f"modbus-tcp://127.0.0.1:{unused_tcp_port}")


@pytest.mark.needs_program("mbpoll", "socat")
async def test_the_driver_reads_a_libmodbus_server_over_rtu(tmp_path):
    ends = [tmp_path / "device", tmp_path / "bench"]
    socat = subprocess.Popen(["socat", *(f"pty,raw,echo=0,link={end}" for end in ends)])
    with ended(socat):
        await holds(lambda: all(Path(end).exists() for end in ends), "both ends of the line")
        with ended(libmodbus_server("rtu", str(ends[0]))):
            await _against_libmodbus(f"modbus-rtu://{ends[1]}?baud=115200")
