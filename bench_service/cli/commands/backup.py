"""`bench-service backup`: a copy of all that is stored, also while the service runs."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from bench_service.cli.command import Command
from bench_service.cli.output import Output

_DAMAGED = 1


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("out", type=Path, metavar="DIRECTORY", help="new directory for the copy")
    parser.add_argument("--config", type=Path, metavar="bench.toml", help="which says where the data are")


def _run(options: Namespace, output: Output) -> int:
    # Lazy: sqlalchemy and pydantic take 340 ms.
    from bench_service.config import load_config
    from bench_service.store.backup import take

    answer = take(load_config(options.config).data_dir, options.out).to_json()
    told = f"copied {answer['runs']} runs, {answer['samples']} samples to {answer['file']}: {answer['state']}"
    output.result(answer, lambda console: console.print(told))
    return 0 if answer["state"] == "whole" else _DAMAGED


COMMAND = Command("backup", "copy all that is stored, also while the service runs", _arguments, _run)
