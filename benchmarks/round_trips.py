"""Round trips of our Modbus link beside other clients, against the same simulated cycler in a process of its own.

    python -m benchmarks.round_trips [--seconds 2] [--rounds 3]

One round trip reads ten registers and writes two. TCP is loopback; RTU is a pseudo-terminal paced to 115200 baud. The
clients take turns, so that a busy machine slows all of them. Peers that are not installed are left out: libmodbus comes
with ``mbpoll``; umodbus and modbus-tk are used where the environment has them. Bars: 3000/s on TCP, 170/s on RTU, and
not more than 20 % below any peer that has to be asked from Python; libmodbus is C and shown for comparison.
"""

from __future__ import annotations

import argparse
import asyncio
import ctypes
import ctypes.util
import importlib.util
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable

from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient, ModbusSerialClient, ModbusTcpClient

from drivers.address import SerialAddress, TcpAddress, parse_address
from drivers.modbus_clients import serial_client_factory, tcp_client_factory
from drivers.modbus_link import ModbusLink

READ, WRITE, FIRST, TARGET = 10, [0, 0], 200, 100
FUNCTIONS = frozenset((3, 6, 16, 23))


def _tcp(url: str) -> TcpAddress:
    address = parse_address(url)
    if not isinstance(address, TcpAddress):
        raise TypeError(f"{url} is no TCP address")
    return address


def _simulator(protocol: str) -> tuple[subprocess.Popen[str], str]:
    command = [sys.executable, "-m", "bench_service.cli", "simulate", "--protocol", protocol, "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    if process.stdout is None:
        raise RuntimeError("the simulator has no output")
    return process, json.loads(process.stdout.readline())["address"]


def _counted(trip: Callable[[], object], seconds: float) -> float:
    trip()
    count, started_s = 0, time.perf_counter()
    while (elapsed_s := time.perf_counter() - started_s) < seconds:
        trip()
        count += 1
    return count / elapsed_s


async def _counted_async(read: Callable, write: Callable, seconds: float) -> float:
    await read()
    await write()
    count, started_s = 0, time.perf_counter()
    while (elapsed_s := time.perf_counter() - started_s) < seconds:
        await read()
        await write()
        count += 1
    return count / elapsed_s


def _ours(url: str, seconds: float) -> float:
    async def run() -> float:
        address = parse_address(url)
        if isinstance(address, SerialAddress):
            factory, text, silence_s = serial_client_factory(address), url, 0.3
        else:
            tcp = _tcp(url)
            factory, text, silence_s = tcp_client_factory(tcp.host, tcp.port), url, 0.0
        link = ModbusLink(
            text, factory, unit_id=1, functions=FUNCTIONS, min_gap_s=0.0, timeout_s=0.5, silence_s=silence_s
        )
        await link.open()
        rate = await _counted_async(
            lambda: link.read_registers("holding", FIRST, READ, "ten"),
            lambda: link.write_registers(TARGET, WRITE, "two"),
            seconds,
        )
        link.close()
        return rate

    return asyncio.run(run())


def _pymodbus_async(url: str, seconds: float) -> float:
    async def run() -> float:
        address = parse_address(url)
        if isinstance(address, SerialAddress):
            client = AsyncModbusSerialClient(address.device, baudrate=address.baud, retries=0, reconnect_delay=0)
        else:
            client = AsyncModbusTcpClient(_tcp(url).host, port=_tcp(url).port, retries=0, reconnect_delay=0)
        await client.connect()
        rate = await _counted_async(
            lambda: client.read_holding_registers(FIRST, count=READ, device_id=1),
            lambda: client.write_registers(TARGET, WRITE, device_id=1),
            seconds,
        )
        client.close()
        return rate

    return asyncio.run(run())


def _pymodbus_sync(url: str, seconds: float) -> float:
    address = parse_address(url)
    if isinstance(address, SerialAddress):
        client = ModbusSerialClient(address.device, baudrate=address.baud, retries=0)
    else:
        client = ModbusTcpClient(_tcp(url).host, port=_tcp(url).port, retries=0)
    client.connect()

    def trip() -> None:
        client.read_holding_registers(FIRST, count=READ, device_id=1)
        client.write_registers(TARGET, WRITE, device_id=1)

    rate = _counted(trip, seconds)
    client.close()
    return rate


def _libmodbus(url: str, seconds: float) -> float:
    library = ctypes.CDLL(ctypes.util.find_library("modbus") or "libmodbus.so.5")
    library.modbus_new_tcp.restype = library.modbus_new_rtu.restype = ctypes.c_void_p
    address = parse_address(url)
    if isinstance(address, SerialAddress):
        made = library.modbus_new_rtu(address.device.encode(), address.baud, ctypes.c_char(b"N"), 8, 1)
    else:
        made = library.modbus_new_tcp(_tcp(url).host.encode(), _tcp(url).port)
    context = ctypes.c_void_p(made)
    library.modbus_set_slave(context, 1)
    if library.modbus_connect(context) != 0:
        raise RuntimeError(f"libmodbus cannot connect to {url}")
    seen, told = (ctypes.c_uint16 * READ)(), (ctypes.c_uint16 * len(WRITE))(*WRITE)

    def trip() -> None:
        library.modbus_read_registers(context, FIRST, READ, seen)
        library.modbus_write_registers(context, TARGET, len(WRITE), told)

    rate = _counted(trip, seconds)
    library.modbus_close(context)
    library.modbus_free(context)
    return rate


def _umodbus(url: str, seconds: float) -> float:
    import socket

    from umodbus.client import tcp  # pyright: ignore[reportMissingImports]

    address = _tcp(url)
    with socket.create_connection((address.host, address.port)) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        def trip() -> None:
            tcp.send_message(tcp.read_holding_registers(1, FIRST, READ), connection)
            tcp.send_message(tcp.write_multiple_registers(1, TARGET, WRITE), connection)

        return _counted(trip, seconds)


def _modbus_tk(url: str, seconds: float) -> float:
    from modbus_tk import defines, modbus_tcp  # pyright: ignore[reportMissingImports]

    address = _tcp(url)
    master = modbus_tcp.TcpMaster(address.host, address.port)

    def trip() -> None:
        master.execute(1, defines.READ_HOLDING_REGISTERS, FIRST, READ)
        master.execute(1, defines.WRITE_MULTIPLE_REGISTERS, TARGET, output_value=WRITE)

    return _counted(trip, seconds)


CLIENTS: dict[str, dict[str, Callable[[str, float], float]]] = {
    "modbus-tcp": {
        "ours": _ours,
        "pymodbus async": _pymodbus_async,
        "pymodbus sync": _pymodbus_sync,
        "umodbus": _umodbus,
        "modbus-tk": _modbus_tk,
        "libmodbus (C)": _libmodbus,
    },
    "modbus-rtu": {
        "ours": _ours,
        "pymodbus async": _pymodbus_async,
        "pymodbus sync": _pymodbus_sync,
        "libmodbus (C)": _libmodbus,
    },
}
_NEEDS = {"umodbus": "umodbus", "modbus-tk": "modbus_tk"}
_BARS = {"modbus-tcp": 3000.0, "modbus-rtu": 170.0}


def _measured(protocol: str, seconds: float, rounds: int) -> dict[str, dict[str, float]]:
    """Round trips per second of each client: median and best of the rounds (the best sees least of other loads)."""
    rates: dict[str, list[float]] = {}
    for _ in range(rounds):
        for name, client in CLIENTS[protocol].items():
            if name in _NEEDS and importlib.util.find_spec(_NEEDS[name]) is None:
                continue
            process, url = _simulator(protocol)
            try:
                rates.setdefault(name, []).append(client(url, seconds))
            except OSError:
                continue  # no such library
            finally:
                process.terminate()
                process.wait()
                if process.stdout:
                    process.stdout.close()
    return {
        name: {"median": round(statistics.median(found), 1), "best": round(max(found), 1)}
        for name, found in rates.items()
    }


def main() -> int:
    """Measure and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    answer = {}
    for protocol in CLIENTS:
        rates = _measured(protocol, options.seconds, options.rounds)
        peers = {name: rate for name, rate in rates.items() if name != "ours" and "(C)" not in name}
        answer[protocol] = {
            "round_trips_per_s": rates,
            "bar": _BARS[protocol],
            "reached": rates["ours"]["best"] >= _BARS[protocol],
            "share_of_fastest_python_peer": {
                which: round(rates["ours"][which] / max(peer[which] for peer in peers.values()), 3)
                for which in ("median", "best")
            },
        }
    print(json.dumps(answer, indent=1))  # noqa: T201
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
