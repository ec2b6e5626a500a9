"""`bench-service simulate`: a cell and a cycler that are not there, behind a real protocol."""

from __future__ import annotations

import asyncio
from argparse import ArgumentParser, Namespace

from bench_service.cli.arguments import fraction, named_numbers, natural, number, port, positive
from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--protocol", choices=["modbus-tcp"], default="modbus-tcp")
    parser.add_argument("--map", default="generic", metavar="NAME", help="device map: a name or a .toml file")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: this machine only)")
    parser.add_argument("--port", type=port, default=0, metavar="N", help="0, the default, takes a free one")
    parser.add_argument("--cell", choices=["nmc", "lfp", "nimh"], default="nmc")
    parser.add_argument(
        "--effects",
        type=named_numbers,
        default={},
        metavar="NAME=X,...",
        help="physical effects and their size, such as hysteresis=0.02,relaxation=0.008",
    )
    parser.add_argument("--seed", type=natural, default=0, metavar="N", help="of all noise")
    parser.add_argument("--capacity-Ah", type=positive, metavar="Q", help="instead of the cell's own")
    parser.add_argument("--initial-soc", type=fraction, default=0.5, metavar="S", help="where the cell starts, 0..1")
    parser.add_argument("--ambient-degC", type=number, default=25.0, metavar="T")
    clock = parser.add_mutually_exclusive_group()
    clock.add_argument("--lock-step", action="store_true", help="time moves only with the client's ticks")
    clock.add_argument("--speed", type=positive, default=1.0, metavar="X", help="simulated seconds per second")


def _run(options: Namespace, output: Output) -> int:
    from simulators.bench import SimulatorError, SimulatorSettings, serve

    def ready(address: str) -> None:
        answer = {"address": address, "state": "listening"}
        output.result(answer, lambda console: console.print(f"listening on {address}"))

    try:
        settings = SimulatorSettings(
            protocol=options.protocol,
            map_name=options.map,
            host=options.host,
            port=options.port,
            cell=options.cell,
            effects=options.effects,
            seed=options.seed,
            lock_step=options.lock_step,
            speed=options.speed,
            capacity_Ah=options.capacity_Ah,
            initial_soc=options.initial_soc,
            ambient_degC=options.ambient_degC,
        )
        asyncio.run(serve(settings, ready))
    except KeyboardInterrupt:
        return 0  # Ctrl-C is how a simulator is meant to be ended
    except (SimulatorError, ValueError) as error:
        raise UsageError(str(error)) from error
    return 0


COMMAND = Command("simulate", "serve a simulated cell and cycler over a real protocol", _arguments, _run)
