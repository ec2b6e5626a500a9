"""`bench-service config init`: a commented configuration to start from."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.output import Output


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("action", choices=["init"], help="init writes a commented file with the default values")
    parser.add_argument("--out", type=Path, default=Path("bench.toml"), metavar="FILE", help="default: bench.toml")
    parser.add_argument("--force", action="store_true", help="replace a file that is there")


def _run(options: Namespace, output: Output) -> int:
    # Lazy: pydantic and numpy take 180 ms.
    from bench_service.config import example_config
    from bench_service.exchange.atomic import write_atomically

    if options.out.exists() and not options.force:
        raise UsageError(f"{options.out}: exists already; name another with --out, or replace it with --force")
    write_atomically(options.out, example_config().encode())
    output.result({"file": str(options.out)}, lambda console: console.print(f"wrote {options.out}"))
    return 0


COMMAND = Command("config", "write a commented configuration file", _arguments, _run)
