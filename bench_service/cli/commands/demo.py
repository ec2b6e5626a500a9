"""`bench-service demo`: the main job on a simulated bench, over the real protocol, from design to report."""

from __future__ import annotations

import signal
import sys
import time
from argparse import ArgumentParser, Namespace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.cli.arguments import natural
from bench_service.cli.command import Command
from bench_service.cli.demo_report import demo_answer, show_demo
from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output, Report
from bench_service.cli.report_options import check_report, kind_of
from bench_service.exchange.atomic import write_atomically
from simulators.catalogue import cell_type

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench_service.config import ServiceConfig
    from simulators.hidden_effect import HiddenEffect

# A demo's benches run in simulated time: nothing is disturbed by its fits, and on a busy machine they must get on.
_WORKER_NICE = 0
_BENCH = "sim"
_CHANGED_BENCH = "sim_changed"
_CELLS = ("nmc", "lfp", "nimh")
_MAPS = {"modbus-tcp": "generic", "modbus-rtu": "generic", "can": "generic_can"}
_BAUDS = (19_200, 115_200, 921_600)  # at 115200 the line alone takes five minutes for 60 000 samples
# As the service has it; known here without loading the service.
_MOST_ROUNDS = 5
# Charge is counted on the capacity that the cell had: with 15 % less of it, the most that is hidden, the cell must stay
# inside its voltage limits.
_HIDDEN_SOC = [0.15, 0.8]


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--exit", action="store_true", help="end after the report instead of keeping the page up")
    parser.add_argument("--cell", choices=_CELLS, default="nmc", help="chemistry of the simulated cell")
    parser.add_argument("--protocol", choices=tuple(_MAPS), default="modbus-tcp")
    parser.add_argument("--baud", type=int, choices=_BAUDS, default=_BAUDS[-1], help="pace of the Modbus RTU line")
    parser.add_argument(
        "--hidden-effect",
        default="none",
        metavar="NAME|random|none",
        help="seal an effect in the simulated cell and let the campaign find it",
    )
    parser.add_argument(
        "--mode",
        choices=("structure", "change"),
        default="change",
        help="change: the cell gets the effect after it was modelled; structure: a plain cell has it from the start, "
        "and the model's structure lacks it",
    )
    parser.add_argument(
        "--rounds",
        type=natural,
        choices=range(1, _MOST_ROUNDS + 1),
        default=1,
        metavar="N",
        help="training runs; from the second on each is designed from the model so far, and judged beside it",
    )
    parser.add_argument("--seed", type=natural, default=1, metavar="N", help="of cell, noise and profiles")
    parser.add_argument("--report", type=Path, metavar="FILE.html|.pdf", help="also write a report of the campaign")
    where = "default: BENCH_DATA_DIR, else a new folder in bench-data/demo"
    parser.add_argument("--data", type=Path, metavar="DIR", help=where)


def _run(options: Namespace, output: Output) -> int:
    # Lazy: sqlalchemy, httpx and numpy take 390 ms.
    from bench_service.cli.service import own_service

    started_s = time.monotonic()
    check_report(options)
    hidden = _hidden_effect(options)
    config = _config(options, hidden)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends it as Ctrl-C does: bench at rest, all stored
    with own_service(config, _BENCH) as client:
        if not options.json:
            _tell(f"Watch it at {client.url}/")
            if hidden is not None:
                _tell(f"An effect is hidden in the cell. Its seal (SHA-256): {hidden.seal}")
        record = client.start_campaign(_request(options, hidden))
        with output.progress("Demo campaign") as report:
            in_lines = not (options.json or sys.stderr.isatty())
            try:
                record = client.wait_campaign(record["id"], watcher(report, in_lines))
            except KeyboardInterrupt:
                client.stop_campaign(record["id"])
                raise
        answer = demo_answer(record, hidden, time.monotonic() - started_s)
        answer |= {"data": str(config.data_dir), "address": client.url, "state": record["state"]}
        if options.report is not None:
            write_atomically(options.report, client.campaign_report(record["id"], kind_of(options.report)))
            answer["report"] = str(options.report)
        output.result(answer, lambda console: show_demo(console, record, answer))
        if stays_up(options, sys.stdout.isatty()):
            _keep_page_up(client.url)
    return 0 if record["state"] == "completed" else 1


def watcher(report: Report, in_lines: bool) -> Callable[[dict[str, Any]], None]:
    """Tell of a campaign on a bar, or by a line as each stage ends, where there is no bar."""
    told: set[str] = set()

    def watch(found: dict[str, Any]) -> None:
        report(found["progress"], f"{found['stage']}: {found['message']}")
        for stage in found["stages"] if in_lines else ():
            if stage["state"] not in ("waiting", "running") and stage["name"] not in told:
                told.add(stage["name"])
                seconds = "" if stage["seconds"] is None else f" after {stage['seconds']:.0f} s"
                _tell(f"{stage['name']}: {stage['state']}{seconds}. {stage['detail']}")

    return watch


def _hidden_effect(options: Namespace) -> HiddenEffect | None:
    # Lazy: numpy takes 70 ms.
    from simulators.hidden_effect import draw

    if options.hidden_effect == "none":
        return None
    try:
        return draw(options.hidden_effect, cell_type(options.cell).parameters, options.seed, options.mode)
    except ValueError as error:
        raise UsageError(f"--hidden-effect: {error}") from None


def _config(options: Namespace, hidden: HiddenEffect | None) -> ServiceConfig:
    # Lazy: pydantic takes 120 ms.
    from bench_service.config import BenchConfig, LimitsConfig, ServiceConfig, SimulateConfig, named_data_dir
    from simulators.hidden_effect import game_cell

    cell = cell_type(options.cell)
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    data = options.data or named_data_dir() or Path("bench-data") / "demo" / f"{stamp}-{options.cell}-{options.seed}"
    limits = LimitsConfig(
        voltage_V=cell.limits.voltage_V,
        current_A=cell.limits.current_A,
        temperature_degC=cell.limits.temperature_degC,
    )

    def bench(effects: dict[str, float]) -> BenchConfig:
        return BenchConfig(
            simulate=SimulateConfig(
                protocol=options.protocol, baud=options.baud, cell=options.cell, seed=options.seed, effects=effects
            ),
            map=_MAPS[options.protocol],
            capacity_Ah=cell.parameters.capacity_Ah,
            limits=limits,
        )

    own = {} if hidden is None else game_cell(cell.parameters, options.mode)
    effects = own if hidden is None else own | {hidden.name: hidden.value}
    if hidden is None or options.mode == "structure":
        return ServiceConfig(data_dir=data, worker_nice=_WORKER_NICE, bench={_BENCH: bench(effects)})
    # The same cell before and after; the bench of the second one stands for the first a year later.
    benches = {_BENCH: bench(own), _CHANGED_BENCH: bench(effects)}
    return ServiceConfig(data_dir=data, worker_nice=_WORKER_NICE, bench=benches)


def _request(options: Namespace, hidden: HiddenEffect | None) -> dict[str, Any]:
    request = {"bench": _BENCH, "name": f"demo {options.cell}", "seed": options.seed, "rounds": options.rounds}
    if hidden is not None:
        # What a diagnosis stands on: the model must be closer to the cell than the effect is large.
        request |= {"diagnose": options.mode} | _model_request(options.mode)
        request["soc"] = _HIDDEN_SOC
    return request


def _model_request(mode: str) -> dict[str, Any]:
    """What is modelled: the cell before its change as well as it goes, or without all that its structure may lack."""
    # Lazy: numpy takes 70 ms.
    from simulators.hidden_effect import STRUCTURAL

    if mode == "change":
        return {"structure": "auto", "changed_bench": _CHANGED_BENCH}
    return {"structure": "bounded", "without": list(STRUCTURAL)}


def stays_up(options: Namespace, on_terminal: bool) -> bool:
    """Whether the page is kept up after the report: only for a person, who can see its address and end it."""
    return on_terminal and not (options.exit or options.json)


def _keep_page_up(address: str) -> None:
    _tell(f"The page stays at {address}/ until Ctrl-C.")
    try:
        signal.pause()
    except KeyboardInterrupt:
        sys.stdout.write("\n")


def _tell(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


COMMAND = Command("demo", "run the main job on a simulated bench", _arguments, _run)
