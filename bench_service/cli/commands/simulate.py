"""`bench-service simulate`: a cell and a cycler that are not there, behind a real protocol."""

from __future__ import annotations

import asyncio
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from bench_service.cli.arguments import fraction, named_numbers, natural, number, port, positive
from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output
from bench_service.cli.sealed_effect import sealed_effect

if TYPE_CHECKING:
    from simulators.can_bus import CanBusSettings
    from simulators.chamber import ChamberSettings
    from simulators.module import ModuleLayout

_PRIORITY = 9


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--protocol", choices=["modbus-tcp", "modbus-rtu", "can"], default="modbus-tcp")
    parser.add_argument(
        "--map", metavar="NAME", help="device map: a name or a .toml file (default: generic, or generic_can)"
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: this machine only)")
    parser.add_argument("--port", type=port, default=0, metavar="N", help="0, the default, takes a free one")
    parser.add_argument(
        "--device", metavar="PATH", help="Modbus RTU: a serial port, or where to link the pseudo-terminal"
    )
    parser.add_argument("--baud", type=natural, default=115200, metavar="N", help="Modbus RTU: pace of the line")
    parser.add_argument(
        "--channel",
        metavar="C",
        help="CAN: INTERFACE/CHANNEL, such as socketcan/vcan0 (default: udp_multicast/239.74.163.2:0, a free port)",
    )
    parser.add_argument("--node", type=natural, default=0, metavar="N", help="CAN: number of the node on the bus")
    parser.add_argument("--cell", choices=["nmc", "lfp", "nimh"], default="nmc")
    parser.add_argument(
        "--effects",
        type=named_numbers,
        default={},
        metavar="NAME=X,...",
        help="physical effects and their size, such as hysteresis=0.02,relaxation=0.008",
    )
    parser.add_argument(
        "--hidden-effect",
        metavar="NAME|random",
        help="one more effect, drawn by the seed and not told",
    )
    parser.add_argument("--seal", type=Path, metavar="FILE", help="keep the hidden effect from one start to the next")
    parser.add_argument(
        "--faults",
        default="",
        metavar="SCRIPT",
        help="what goes wrong when, such as 'silence@sample:30; nan.voltage@t:12.5+3'",
    )
    parser.add_argument(
        "--devices", type=natural, default=1, metavar="N", help="so many at one address: Modbus units or CAN nodes"
    )
    parser.add_argument("--module", metavar="SxP", help="a module of S cells in series, P in parallel, such as 4x2")
    parser.add_argument(
        "--chamber",
        nargs="?",
        const="generic_chamber",
        metavar="MAP",
        help="a temperature chamber around the cell, over Modbus TCP beside the cycler (alone: --map generic_chamber)",
    )
    parser.add_argument("--chamber-port", type=port, default=0, metavar="N", help="0, the default, takes a free one")
    parser.add_argument("--chamber-ramp", type=positive, default=3.0, metavar="R", help="fastest change in K/min")
    parser.add_argument("--chamber-faults", default="", metavar="SCRIPT", help="as --faults, of the chamber")
    parser.add_argument("--seed", type=natural, default=0, metavar="N", help="of all noise")
    parser.add_argument("--capacity-Ah", type=positive, metavar="Q", help="instead of the cell's own")
    parser.add_argument("--initial-soc", type=fraction, default=0.5, metavar="S", help="where the cell starts, 0..1")
    parser.add_argument("--ambient-degC", type=number, default=25.0, metavar="T")
    clock = parser.add_mutually_exclusive_group()
    clock.add_argument("--lock-step", action="store_true", help="time moves only with the client's ticks")
    clock.add_argument("--speed", type=positive, default=1.0, metavar="X", help="simulated seconds per second")


def can_bus(channel: str | None, node: int) -> CanBusSettings:
    """Understand `--channel` and `--node`."""
    # Lazy: python-can takes 50 ms.
    from simulators.can_bus import CanBusSettings

    if channel is None:
        return CanBusSettings(node=node)
    interface, _, rest = channel.partition("/")
    group, _, number = rest.rpartition(":") if interface == "udp_multicast" else (rest, "", "0")
    if not group or not number.isdecimal():
        raise UsageError(f"--channel {channel}: write socketcan/vcan0 or udp_multicast/239.74.163.2:43113")
    return CanBusSettings(interface=interface, channel=group, port=int(number), node=node)


def _module(text: str | None) -> ModuleLayout | None:
    # Lazy: numpy takes 70 ms.
    from simulators.module import ModuleLayout

    if text is None:
        return None
    series, _, parallel = text.partition("x")
    if not (series.isdecimal() and parallel.isdecimal()):
        raise UsageError(f"--module {text}: write SxP, such as 4x2 for 4 in series and 2 in parallel")
    return ModuleLayout(cells_in_series=int(series), cells_in_parallel=int(parallel))


def _chamber(options: Namespace) -> ChamberSettings | None:
    # Lazy: numpy takes 70 ms.
    from simulators.chamber import ChamberSettings

    if options.chamber is None:
        return None
    return ChamberSettings(
        map_name=options.chamber,
        port=options.chamber_port,
        ramp_K_per_min=options.chamber_ramp,
        faults=options.chamber_faults,
    )


def _run(options: Namespace, output: Output) -> int:
    # Lazy: python-can and numpy take 220 ms.
    from simulators.bench import SimulatorError, SimulatorSettings, serve
    from simulators.serial_line import SerialSettings

    late: str | None = None
    chamber: str | None = None
    hidden = None
    if options.hidden_effect is not None:
        hidden = sealed_effect(options.hidden_effect, options.cell, options.seed, options.seal)

    def ready(address: str) -> None:
        answer = {"address": address, "state": "listening", "seal": None if hidden is None else hidden.seal}
        answer |= {"real_time": late is None, "reason": late}
        answer |= {} if chamber is None else {"chamber": chamber}
        words = "" if chamber is None else f", its chamber on {chamber}"
        words += "" if late is None else f"; {late}"
        words += "" if hidden is None else f"; an effect is hidden, its seal (SHA-256) is {hidden.seal}"
        output.result(answer, lambda console: console.print(f"listening on {address}{words}"))

    def chamber_ready(address: str) -> None:
        nonlocal chamber
        chamber = address

    try:
        settings = SimulatorSettings(
            protocol=options.protocol,
            map_name=options.map or ("generic_can" if options.protocol == "can" else "generic"),
            host=options.host,
            port=options.port,
            serial=SerialSettings(device=options.device, baud=options.baud),
            can=can_bus(options.channel, options.node),
            cell=options.cell,
            effects=options.effects | ({} if hidden is None else {hidden.name: hidden.value}),
            faults=options.faults,
            chamber=_chamber(options),
            devices=options.devices,
            module=_module(options.module),
            seed=options.seed,
            lock_step=options.lock_step,
            speed=options.speed,
            capacity_Ah=options.capacity_Ah,
            initial_soc=options.initial_soc,
            ambient_degC=options.ambient_degC,
        )
        with _punctual(options) as late:
            asyncio.run(serve(settings, ready, on_chamber=chamber_ready))
    except KeyboardInterrupt:
        return 0  # Ctrl-C is how a simulator is meant to be ended
    except (SimulatorError, ValueError) as error:
        raise UsageError(str(error)) from error
    return 0


@contextmanager
def _punctual(options: Namespace) -> Iterator[str | None]:
    """Run just below the priority of a control process where time is real; gives why it does not, if it cannot."""
    from bench_service.bench.realtime import real_time_priority

    if options.lock_step or options.speed > 1.0:
        yield None  # simulated time is not late
        return
    with real_time_priority(_PRIORITY) as reason:
        yield reason


COMMAND = Command("simulate", "serve a simulated cell and cycler over a real protocol", _arguments, _run)
