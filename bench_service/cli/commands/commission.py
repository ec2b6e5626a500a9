"""`bench-service commission`: look at a bench's device, and prove on it what the bench relies on."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.cli.arguments import positive
from bench_service.cli.command import Command
from bench_service.cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

_WORDS = {"passed": "ok", "failed": "FAILED", "absent": "-"}
_DONE = "commissioned"
_STATES = {"passed": _DONE}
_WARNING = (
    "Now current flows: pulses both ways at a fifth of 1 C (see --current), and the device's limits "
    "and its watchdog are made to switch it off. A cell or a resistor must be connected, and nobody at the leads."
)


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("bench", metavar="BENCH")
    parser.add_argument("--yes", action="store_true", help="go on after the probe without asking: current will flow")
    parser.add_argument("--current", type=positive, metavar="A", help="size of the pulses; default: a fifth of 1 C")
    parser.add_argument(
        "--resistor", type=positive, metavar="OHM", help="a known resistor is connected in place of a cell"
    )
    parser.add_argument("--config", type=Path, metavar="bench.toml")


def _run(options: Namespace, output: Output) -> int:
    # Lazy: sqlalchemy, pydantic and httpx take 520 ms.
    from bench_service.cli.service import connected
    from bench_service.config import load_config

    what = {"current_A": options.current, "resistor_Ohm": options.resistor}
    with connected(load_config(options.config), options.bench) as client:
        answer = client.commission(options.bench, **what)
        if answer["state"] == "probed" and _confirmed(options, output, answer):
            answer = client.commission(options.bench, confirm=True, **what)
    answer["state"] = _STATES.get(answer["state"], answer["state"])
    if answer["state"] == "probed":
        output.warn("read only, nothing is proved: --yes goes on, and lets current flow")
    output.result(answer, lambda console: _show(console, answer))
    return 0 if answer["state"] == _DONE else 1


def _confirmed(options: Namespace, output: Output, probed: dict[str, Any]) -> bool:
    if options.yes or output.as_json or not sys.stdin.isatty():
        return options.yes
    sys.stderr.write("\n".join([*(f"  {_line(check)}" for check in probed["checks"]), _WARNING, "Go on? [y/N] "]))
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def _line(check: dict[str, Any]) -> str:
    return f"{_WORDS[check['outcome']]:6} {check['name']}: {check['text']}"


def _show(console: Console, answer: dict[str, Any]) -> None:
    for check in answer["checks"]:
        console.print(_line(check), markup=False)
    because = f": {answer['reason']}" if answer["reason"] else ""
    console.print(f"{answer['bench']}: {answer['state']}{because}", markup=False)
    if answer["record"] is not None:
        console.print(f"record {answer['record']}, seal {answer['sha256']}")


COMMAND = Command("commission", "look at a bench's device and prove what the bench relies on", _arguments, _run)
