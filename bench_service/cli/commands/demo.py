"""`bench-service demo`: the main job on a simulated bench, over the real protocol, from design to report."""

from __future__ import annotations

import signal
import sys
import time
from argparse import ArgumentParser, Namespace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich import box
from rich.table import Table

from bench_service.cli.arguments import natural
from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output
from simulators.catalogue import cell_type

if TYPE_CHECKING:
    from rich.console import Console

    from bench_service.config import ServiceConfig
    from simulators.hidden_effect import HiddenEffect

_BENCH = "sim"
_CHANGED_BENCH = "sim_changed"
_CELLS = ("nmc", "lfp", "nimh")
_MAPS = {"modbus-tcp": "generic", "modbus-rtu": "generic", "can": "generic_can"}
_BAUDS = (19_200, 115_200, 921_600)  # at 115200 the line alone takes five minutes for 60 000 samples
# As the service has it; known here without loading the service.
_MOST_ROUNDS = 5


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
        help="change: the cell gets the effect after it was modelled; structure: it has it from the start",
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
    parser.add_argument("--data", type=Path, metavar="DIR", help="default: a new folder in bench-data/demo")


def _run(options: Namespace, output: Output) -> int:
    # Lazy: sqlalchemy, httpx and numpy take 390 ms.
    from bench_service.cli.service import own_service

    started_s = time.monotonic()
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
            try:
                record = client.wait_campaign(
                    record["id"], lambda found: report(found["progress"], f"{found['stage']}: {found['message']}")
                )
            except KeyboardInterrupt:
                client.stop_campaign(record["id"])
                raise
        answer = _answer(record, hidden, time.monotonic() - started_s)
        answer |= {"data": str(config.data_dir), "address": client.url, "state": record["state"]}
        output.result(answer, lambda console: _show(console, record, answer))
        if stays_up(options, sys.stdout.isatty()):
            _keep_page_up(client.url)
    return 0 if record["state"] == "completed" else 1


def _hidden_effect(options: Namespace) -> HiddenEffect | None:
    # Lazy: numpy takes 70 ms.
    from simulators.hidden_effect import draw

    if options.hidden_effect == "none":
        return None
    try:
        return draw(options.hidden_effect, cell_type(options.cell).parameters, options.seed)
    except ValueError as error:
        raise UsageError(f"--hidden-effect: {error}") from None


def _config(options: Namespace, hidden: HiddenEffect | None) -> ServiceConfig:
    # Lazy: pydantic takes 120 ms.
    from bench_service.config import BenchConfig, LimitsConfig, ServiceConfig, SimulateConfig

    cell = cell_type(options.cell)
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    data = options.data or Path("bench-data") / "demo" / f"{stamp}-{options.cell}-{options.seed}"
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

    effects = {} if hidden is None else {hidden.name: hidden.value}
    if hidden is None or options.mode == "structure":
        return ServiceConfig(data_dir=data, bench={_BENCH: bench(effects)})
    # The same cell before and after; the bench of the second one stands for the first a year later.
    return ServiceConfig(data_dir=data, bench={_BENCH: bench({}), _CHANGED_BENCH: bench(effects)})


def _request(options: Namespace, hidden: HiddenEffect | None) -> dict[str, Any]:
    request = {"bench": _BENCH, "name": f"demo {options.cell}", "seed": options.seed, "rounds": options.rounds}
    if hidden is not None:
        # What a diagnosis stands on: the model must be closer to the cell than the effect is large.
        request |= {"diagnose": options.mode, "structure": "auto" if options.mode == "change" else "full"}
        request |= {"changed_bench": _CHANGED_BENCH} if options.mode == "change" else {}
    return request


def _answer(record: dict[str, Any], hidden: HiddenEffect | None, seconds: float) -> dict[str, Any]:
    """The `demo` object of the public contract."""
    result = record["result"] or {}
    diagnosis = result.get("diagnosis") or {}
    findings = diagnosis.get("findings") or []
    named = findings[0]["effect"] if diagnosis.get("verdict") in ("missing", "ambiguous") and findings else None
    opened = None if hidden is None else {"value": hidden.value, "before": hidden.before, "unit": hidden.unit}
    return {
        "runs": [run["run_id"] for run in result.get("runs", [])],
        "samples": result.get("samples", 0),
        "missed_ticks": result.get("missed_ticks", 0),
        "rounds": result.get("rounds", []),
        "model_chain": result.get("model_chain", []),
        "hidden_effect": None if hidden is None else hidden.name,
        "hidden_size": opened,
        "seal": None if hidden is None else {"sha256": hidden.seal, "contents": hidden.contents},
        "verdict": diagnosis.get("verdict"),
        "diagnosed_effect": named,
        "soc_rmse": (result.get("soc") or {}).get("rmse"),
        "seconds": seconds,
    }


def _show(console: Console, record: dict[str, Any], answer: dict[str, Any]) -> None:

    stages = Table(box=box.SIMPLE_HEAD)
    for heading in ("stage", "state", "seconds", "what"):
        stages.add_column(heading, justify="right" if heading == "seconds" else "left", overflow="fold")
    for stage in record["stages"]:
        seconds = "" if stage["seconds"] is None else f"{stage['seconds']:.1f}"
        stages.add_row(stage["name"], stage["state"], seconds, stage["detail"])
    console.print(stages)
    if record["state"] != "completed":
        console.print(f"The campaign ended as {record['state']}: {record['message']}")
    else:
        console.print(_figures(record["result"], answer))
        _show_diagnosis(console, record["result"], answer)
    console.print(f"Data: {answer['data']}")
    for run in (record["result"] or {}).get("runs", []):
        console.print(f"Run:  {run['run_id']} ({run['role']})")


def _show_diagnosis(console: Console, result: dict[str, Any], answer: dict[str, Any]) -> None:
    """What the campaign found, then what was hidden."""
    found = result.get("diagnosis")
    if found is None:
        return
    console.print(f"Verdict: [bold]{found['verdict'].replace('_', ' ')}[/bold]")
    for finding in found["findings"][:3]:
        console.print(
            f"  {finding['rank']}. {finding['effect']}, confidence {100 * finding['confidence']:.0f} %: "
            f"{finding['explanation']}"
        )
    for version in answer["model_chain"]:
        effect = "model" if version["effect"] is None else f"with {version['effect']}"
        console.print(f"  {effect}: {version['validation_rmse_mV']:.2f} mV on a run that it never saw")
    if answer["hidden_effect"] is not None:
        size = answer["hidden_size"]
        console.print(
            f"The seal is opened: {answer['hidden_effect']}, {size['value']:g} {size['unit']} "
            f"where the cell had {size['before']:g}"
        )
        console.print(f"  {answer['seal']['sha256']} = SHA-256 of {answer['seal']['contents']!r}")


def _figures(result: dict[str, Any], answer: dict[str, Any]) -> Any:

    table = Table(box=box.SIMPLE_HEAD, show_header=False)
    table.add_column()
    table.add_column(justify="right")
    soc = result["soc"]
    noise = result["sensor_noise_mV"]
    converged = soc["converged_after_s"]
    rows = [
        ("samples stored", f"{answer['samples']}"),
        ("missed ticks", f"{answer['missed_ticks']}"),
        ("free-run voltage error, training run", f"{result['train']['rmse_mV']:.2f} mV"),
        ("free-run voltage error, run the fit never saw", _held_out(result)),
        ("sensor noise", "unknown" if noise is None else f"{noise:.2f} mV"),
        ("live observer: started off by", f"{100 * soc['started_off_by']:.0f} % SoC"),
        ("live observer: below 3 % after", "never" if converged is None else f"{converged:.0f} s"),
        ("live observer: SoC error after that, RMS", f"{100 * soc['rmse']:.2f} %"),
        ("live observer: SoC error after that, largest", f"{100 * soc['max_error']:.2f} %"),
        ("time", f"{answer['seconds']:.0f} s"),
    ]
    for name, value in rows:
        table.add_row(name, value)
    return table


def _held_out(result: dict[str, Any]) -> str:
    """Error after each round."""
    return ", then ".join(f"{each['validation_rmse_mV']:.2f}" for each in result["rounds"]) + " mV"


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
