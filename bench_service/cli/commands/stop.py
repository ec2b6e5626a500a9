"""`bench-service stop`: stop what runs on benches, past the service where that is possible."""

from __future__ import annotations

import time
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output

if TYPE_CHECKING:
    from bench_service.config import ServiceConfig
    from bench_service.stop_tickets import StopTicket

_REASON = "stopped from the command line"
_REST_S = 5.0
_LOOK_S = 0.02
_MOVING = ("running", "paused", "stopping")


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("bench", nargs="?", metavar="BENCH", help="default: all")
    parser.add_argument("--all", action="store_true", help="every bench of the service")
    parser.add_argument("--config", type=Path, metavar="bench.toml")


def _run(options: Namespace, output: Output) -> int:
    # Lazy: pydantic takes 150 ms.
    from bench_service.config import load_config
    from bench_service.stop_tickets import read_tickets

    if options.all and options.bench is not None:
        raise UsageError("name a bench or say --all, not both")
    config = load_config(options.config)
    tickets = {ticket.bench: ticket for ticket in read_tickets(config.data_dir)}
    wanted = tickets if options.bench is None else {name: t for name, t in tickets.items() if name == options.bench}
    stopped = {name: _direct(ticket) for name, ticket in wanted.items()}
    left = {name for name, answer in stopped.items() if answer is None}
    if left or not stopped:
        stopped |= _by_service(config, left or ({options.bench} if options.bench else None))
    if not stopped:
        known = f"no bench {options.bench!r}" if options.bench else "no bench"
        raise UsageError(f"{known} in {config.data_dir}: no service runs there; name its configuration with --config")
    answers = [{"bench": name, **(answer or _unanswered())} for name, answer in sorted(stopped.items())]
    _await_rest(tickets, answers)
    output.result({"benches": answers}, lambda console: console.print(*map(_sentence, answers), sep="\n"))
    return int(any(answer["state"] is None or answer["state"] in _MOVING for answer in answers))


def _direct(ticket: StopTicket) -> dict[str, Any] | None:
    began_s = time.monotonic()
    try:
        state = ticket.ask("stop", _REASON)["state"]
    except OSError:
        return None
    return {"state": state, "way": "direct", "seconds": time.monotonic() - began_s}


def _by_service(config: ServiceConfig, names: set[str] | None) -> dict[str, dict[str, Any] | None]:
    """Ask the service that holds the store; None stands for all benches."""
    # Lazy: sqlalchemy and httpx take 400 ms; whoever gets here has lost the short way already.
    from bench_service.client import BenchClient, ClientError
    from bench_service.config.token import read_token
    from bench_service.store.metadata import MetadataStore

    holder = MetadataStore.holder(config.data_dir)
    if holder is None or holder.url is None:
        return dict.fromkeys(names or (), None) if names and not names.isdisjoint(config.bench) else {}
    found: dict[str, dict[str, Any] | None] = {}
    with BenchClient(holder.url, timeout_s=_REST_S, token=read_token(config.data_dir)) as client:
        try:
            for name in names or [each["name"] for each in client.benches()]:
                began_s = time.monotonic()
                state = client.stop_bench(name)["state"]
                found[name] = {"state": state, "way": "service", "seconds": time.monotonic() - began_s}
        except ClientError as error:
            if error.status is not None:
                raise
            return found | {name: None for name in (names or ()) if name not in found}
    return found


def _await_rest(tickets: dict[str, StopTicket], answers: Iterable[dict[str, Any]]) -> None:
    """Wait a moment for the rest that follows; what is told is what was seen last."""
    end_s = time.monotonic() + _REST_S
    for answer in answers:
        while answer["state"] in _MOVING and answer["way"] == "direct" and time.monotonic() < end_s:
            time.sleep(_LOOK_S)
            try:
                answer["state"] = tickets[answer["bench"]].ask("state")["state"]
            except OSError:
                break


def _unanswered() -> dict[str, Any]:
    return {"state": None, "way": None, "seconds": None}


def _sentence(answer: dict[str, Any]) -> str:
    if answer["state"] is None:
        return f"{answer['bench']}: nobody has answered; use the cycler's own stop if current must go off"
    return f"{answer['bench']}: {answer['state']} (taken in {1000 * answer['seconds']:.0f} ms, {answer['way']})"


COMMAND = Command("stop", "stop what runs on a bench, or on all: rest, output off", _arguments, _run)
