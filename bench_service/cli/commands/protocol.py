"""`bench-service protocol`: the standard tests, checks, other programs' formats, and what cycles have moved."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.cli.arguments import positive
from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from bench_service.bench.limits import Limits
    from bench_service.protocol.program import ChamberWindow

_FORMATS = ("own", "unicycler", "pybamm")
_ACTIONS = ("list", "check", "convert", "cycles")


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "action",
        choices=_ACTIONS,
        help="list the standard tests; check a protocol against a bench; write it in another format; "
        "tell what each cycle of a run has moved",
    )
    parser.add_argument("what", nargs="?", metavar="FILE|TEST|RUN", help="protocol file, standard test, or run's id")
    parser.add_argument("--bench", default="sim", metavar="NAME", help="whose limits and capacity count; default: sim")
    parser.add_argument("--config", type=Path, metavar="bench.toml")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="parameter of a standard test")
    parser.add_argument("--initial-soc", type=float, default=0.5, metavar="S", help="for the time that it takes; 0.5")
    parser.add_argument("--capacity-Ah", type=positive, metavar="Q", help="behind C-rates, in place of the protocol's")
    parser.add_argument("--to", choices=_FORMATS, default="own", help="format to write; default: own")
    parser.add_argument("--out", type=Path, metavar="FILE", help="where convert writes")


def _run(options: Namespace, output: Output) -> int:
    if options.action == "list":
        return _list(output)
    if options.what is None:
        raise UsageError(f"protocol {options.action}: name a file, a standard test or a run")
    return {"check": _check, "convert": _convert, "cycles": _cycles}[options.action](options, output)


def _list(output: Output) -> int:
    from bench_service.protocol.library import standard_tests

    tests = [test.to_json() for test in standard_tests()]

    def show(console: Console) -> None:
        for test in tests:
            console.print(f"[bold]{test['name']}[/bold]: {test['sentence']}")
            for name, each in test["parameters"].items():
                unit = f" {each['unit']}" if each["unit"] else ""
                console.print(f"    {name} = {each['default']}{unit}: {each['meaning']}", markup=False)

    output.result({"standard_tests": tests}, show)
    return 0


def _check(options: Namespace, output: Output) -> int:
    from bench_service.bench.protocol_window import window_of
    from bench_service.campaign.ordering import program_for
    from bench_service.campaign.protocol_design import with_designs
    from bench_service.protocol.preview import preview

    limits, capacity_Ah, chamber = _bench(options)
    document = _document(options, limits, capacity_Ah)
    document = with_designs(document, window_of(limits), capacity_Ah)
    protocol, _, program = program_for(document, limits, capacity_Ah, chamber)
    seen = preview(program, options.initial_soc, 1.0)
    answer = {
        "name": protocol.name,
        "state": "ok",
        "steps": program.n_steps,
        "capacity_Ah": program.capacity_Ah,
        "expected_s": seen.duration_s,
        "expected_end": seen.stopped,
    }

    def show(console: Console) -> None:
        length = "longer than can be foreseen" if seen.duration_s is None else f"about {seen.duration_s / 3600:.2g} h"
        end = "" if seen.stopped is None else f"; on a nominal cell it would not come to its end: {seen.stopped}"
        console.print(f"{protocol.name}: ok, {program.n_steps} steps, {length}{end}", markup=False)

    output.result(answer, show)
    return 0


def _convert(options: Namespace, output: Output) -> int:
    from bench_service.bench.protocol_window import window_of
    from bench_service.campaign.protocol_design import with_designs
    from bench_service.exchange.atomic import check_writable, write_atomically
    from bench_service.protocol.document import read_protocol
    from bench_service.protocol.formats.pybamm import to_pybamm
    from bench_service.protocol.formats.unicycler_out import to_unicycler

    if options.out is None:
        raise UsageError("protocol convert: say where to with --out FILE")
    check_writable(options.out)
    limits, capacity_Ah, _ = _bench(options)
    document = _document(options, limits, capacity_Ah)
    read_protocol(document)
    if options.to == "unicycler":
        content: Any = to_unicycler(document)
    elif options.to == "pybamm":
        content = to_pybamm(document)
    else:
        content = with_designs(document, window_of(limits), capacity_Ah)
    write_atomically(options.out, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())
    answer = {"file": str(options.out), "format": options.to, "state": "ok"}
    output.result(answer, lambda console: console.print(f"wrote {options.out} ({options.to})", markup=False))
    return 0


def _cycles(options: Namespace, output: Output) -> int:
    from bench_service.cli.run_tables import show as show_cycles
    from bench_service.cli.run_tables import stored_cycles
    from bench_service.config import load_config

    cycles = stored_cycles(load_config(options.config), options.what)
    output.result({"run": options.what, "cycles": cycles}, lambda console: show_cycles(console, cycles))
    return 0


def _bench(options: Namespace) -> tuple[Limits, float, ChamberWindow | None]:
    from bench_service.bench.limits import Limits
    from bench_service.campaign.chambers import chamber_window
    from bench_service.config import load_config

    config = load_config(options.config)
    if options.bench not in config.bench:
        raise UsageError(f"unknown bench {options.bench!r}; the configuration has {', '.join(sorted(config.bench))}")
    bench = config.bench[options.bench]
    return Limits.from_json(bench.limits.model_dump()), bench.capacity_Ah, chamber_window(bench)


def _document(options: Namespace, limits: Limits, capacity_Ah: float) -> dict[str, Any]:
    document = _written(options, limits, capacity_Ah)
    return document if options.capacity_Ah is None else {**document, "capacity_Ah": options.capacity_Ah}


def _written(options: Namespace, limits: Limits, capacity_Ah: float) -> dict[str, Any]:
    from bench_service.bench.protocol_window import window_of
    from bench_service.cli.playable import read_protocol_file
    from bench_service.protocol.formats.pybamm import read_strings
    from bench_service.protocol.library import build_test

    path = Path(options.what)
    if not path.exists() and "/" not in options.what and "." not in options.what:
        return build_test(options.what, _parameters(options.set), window_of(limits), capacity_Ah)
    if options.set:
        raise UsageError("--set is for the parameters of a standard test")
    if path.suffix == ".txt":
        return read_strings(path)
    return read_protocol_file(path)


def _parameters(given: list[str]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for text in given:
        name, equals, value = text.partition("=")
        try:
            found[name] = json.loads(value)
        except json.JSONDecodeError:
            equals = ""
        if not equals:
            raise UsageError(f"--set {text}: write NAME=VALUE with a number, or a list in brackets")
    return found


COMMAND = Command("protocol", "list, check and convert test protocols; tables of their cycles", _arguments, _run)
