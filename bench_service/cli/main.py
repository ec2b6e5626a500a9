"""Entry of `bench-service`: finds the command, runs it, turns errors into one line and an exit status.

0 done, 2 bad input (one line on standard error), 1 anything else.
"""

from __future__ import annotations

import os
import sys
import traceback
from argparse import Namespace
from collections.abc import Sequence
from importlib.metadata import version

from bench_service.cli.arguments import OneLineParser
from bench_service.cli.command import Command, find_commands
from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output
from bench_service.errors import BadRequestError, ConflictError, NotFoundError
from bench_service.numerics import one_thread

_FAILED, _BAD_INPUT = 1, 2
_OWN_PACKAGES = frozenset({"bench_service", "drivers", "models", "simulators"})
# HTTP: unknown, busy, too large, of the wrong kind, refused.
_BAD_REQUESTS = frozenset({404, 409, 413, 415, 422})


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command line; returns the exit status."""
    one_thread()
    arguments = sys.argv[1:] if arguments is None else arguments
    if "_ARGCOMPLETE" in os.environ:
        _complete(os.environ.get("COMP_LINE", "").split())
    try:
        options = _parser(find_commands(arguments[0] if arguments else None)).parse_args(arguments)
        return _run(options)
    except KeyboardInterrupt:
        return _complain("interrupted", _FAILED)


def _complete(words: list[str]) -> None:
    """Answer a shell that asks what could come next, and end; nothing happens where it asks for something else."""
    # Lazy: 20 ms at each start.
    import argcomplete

    # The command that is typed, once it is whole: the others need not be loaded.
    typed = words[1] if len(words) > 2 or (len(words) == 2 and os.environ["COMP_LINE"].endswith(" ")) else None
    argcomplete.autocomplete(_parser(find_commands(typed)))


def _run(options: Namespace) -> int:
    command: Command = options.command
    try:
        return command.run(options, Output(options.json))
    except BrokenPipeError:
        # Whoever read our output has gone; Python would complain once more when it flushes at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _FAILED
    except Exception as error:
        if options.traceback:
            traceback.print_exc()
            return _status(error)
        own = type(error).__module__.partition(".")[0] in _OWN_PACKAGES
        return _complain(str(error) if own else f"{type(error).__name__}: {error}", _status(error))


def _parser(commands: list[Command]) -> OneLineParser:
    parser = OneLineParser(
        prog="bench-service",
        description="Open battery test bench: plays current profiles safely, identifies and judges cell models.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"bench-service {version('bench-service')}")
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in commands:
        each = subparsers.add_parser(command.name, help=command.title, description=command.title, allow_abbrev=False)
        each.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
        each.add_argument("--traceback", action="store_true", help="show where in the program an error arose")
        command.arguments(each)
        each.set_defaults(command=command)
    return parser


def _complain(text: str, status: int) -> int:
    sys.stderr.write(f"error: {' '.join(text.split())}\n")
    return status


def _status(error: Exception) -> int:
    """Tell bad input from everything else. Imports here: only a command that fails pays for them."""
    # Lazy: pydantic, httpx and rich take 190 ms.
    from bench_service.client import ClientError
    from bench_service.config import ConfigError
    from bench_service.simulation import SimulationError
    from drivers.errors import BadMapError
    from models.data.errors import ModelError

    if isinstance(error, ClientError):
        return _BAD_INPUT if error.status in _BAD_REQUESTS else _FAILED
    # A simulator that does not start was configured with a map, a cell or an effect that there is not.
    configured = (ConfigError, BadMapError, SimulationError)
    bad_input = (UsageError, BadRequestError, ConflictError, NotFoundError, ModelError, *configured)
    return _BAD_INPUT if isinstance(error, bad_input) else _FAILED
