"""`bench-service restore`: make a data directory from a copy."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from bench_service.cli.command import Command
from bench_service.cli.output import Output

_DAMAGED = 1


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("backup", type=Path, metavar="DIRECTORY", help="a copy made by 'bench-service backup'")
    parser.add_argument("--config", type=Path, metavar="bench.toml", help="which says where the data shall be")


def _run(options: Namespace, output: Output) -> int:
    # Lazy: sqlalchemy and pydantic take 340 ms.
    from bench_service.config import load_config
    from bench_service.store.backup import put_back

    answer = put_back(options.backup, load_config(options.config).data_dir).to_json()
    told = f"put {answer['runs']} runs, {answer['samples']} samples back to {answer['file']}: {answer['state']}"
    output.result(answer, lambda console: console.print(told))
    return 0 if answer["state"] == "whole" else _DAMAGED


COMMAND = Command("restore", "put a copy back where nothing is stored yet", _arguments, _run)
