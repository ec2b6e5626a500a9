"""`bench-service emulate`: a battery in real time, for power hardware and tests of battery management systems."""

from __future__ import annotations

import asyncio
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from bench_service.cli.arguments import fraction, number, port, positive
from bench_service.cli.command import Command
from bench_service.cli.commands.simulate import can_bus
from bench_service.cli.errors import UsageError
from bench_service.cli.files import read_model, read_module
from bench_service.cli.output import Output
from simulators.catalogue import cell_type

if TYPE_CHECKING:
    from simulators.cell import TruthCell


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("model", nargs="?", type=Path, metavar="MODEL.json", help="identified model of the cell")
    parser.add_argument("--cell", choices=["nmc", "lfp", "nimh"], help="a simulated cell instead of a model")
    parser.add_argument("--module", type=Path, metavar="MODULE.json", help="identified module model (S1 to S4)")
    parser.add_argument("--protocol", choices=["modbus-tcp", "can"], default="modbus-tcp")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: this machine only)")
    parser.add_argument("--port", type=port, default=0, metavar="N", help="0, the default, takes a free one")
    parser.add_argument("--channel", metavar="C", help="CAN: INTERFACE/CHANNEL, as for simulate")
    parser.add_argument("--rate-Hz", type=positive, default=100.0, metavar="F", help="how often it answers")
    parser.add_argument("--initial-soc", type=fraction, default=0.5, metavar="S")
    parser.add_argument("--temperature-degC", type=number, default=25.0, metavar="T")
    parser.add_argument("--seconds", type=positive, metavar="S", help="end after so long (default: at Ctrl-C)")


def _run(options: Namespace, output: Output) -> int:
    # Lazy: python-can and numpy take 220 ms.
    from simulators.emulator import EmulatorSettings, serve_battery

    def ready(address: str) -> None:
        answer = {"address": address, "state": "listening"}
        output.result(answer, lambda console: console.print(f"battery at {address}"))

    try:
        cell, cells = _battery(options)
        settings = EmulatorSettings(
            protocol=options.protocol,
            host=options.host,
            port=options.port,
            can=can_bus(options.channel, 0),
            rate_Hz=options.rate_Hz,
            seconds=options.seconds,
            cells_in_series=cells,
        )
        pace = asyncio.run(serve_battery(cell, settings, ready))
    except KeyboardInterrupt:
        return 0  # Ctrl-C is how it is meant to be ended
    except (OSError, ValueError) as error:
        raise UsageError(str(error)) from error
    if not options.json:
        late_ms = 1e3 * pace.latest_s
        output.result({}, lambda console: console.print(f"{pace.ticks} ticks, {pace.missed} missed, {late_ms:.1f} ms"))
    return 0


def _battery(options: Namespace) -> tuple[TruthCell, int]:
    """Return what behaves like the battery, and how many cells it has in series."""
    # Lazy: numba and scipy take 1.2 s.
    from bench_service.cli.network_cell import ModuleOfCells, NetworkCell
    from models.thermal.cell_temperature import thermal_of
    from simulators.cell import Cell

    if (options.model is None) == (options.cell is None):
        raise UsageError("give either a MODEL.json or --cell")
    cell: TruthCell
    if options.cell is not None:
        cell = Cell(cell_type(options.cell).parameters, options.initial_soc, options.temperature_degC)
    else:
        network = read_model(options.model)
        cell = NetworkCell(network, options.initial_soc, options.temperature_degC, thermal_of(network))
    if options.module is None:
        return cell, 1
    module = read_module(options.module)
    return ModuleOfCells(cell, module), module.cells_in_series


COMMAND = Command("emulate", "serve a cell or a module as a battery in real time", _arguments, _run)
