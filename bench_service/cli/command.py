"""What a command is, and which there are."""

from __future__ import annotations

import importlib
import pkgutil
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from dataclasses import dataclass

from bench_service.cli import commands
from bench_service.cli.output import Output


@dataclass(frozen=True, slots=True)
class Command:
    """One command of `bench-service`.

    Attributes
    ----------
    name : as typed
    title : one line for `--help`
    arguments : adds its arguments to a parser (`--json` is there already)
    run : does it; returns the exit status (0, or 1 where the work itself ended badly), raises on bad input
    """

    name: str
    title: str
    arguments: Callable[[ArgumentParser], None]
    run: Callable[[Namespace, Output], int]


def find_commands() -> list[Command]:
    """Return all commands, by name. Their modules import what is slow to import only when they run."""
    found = []
    for module in pkgutil.iter_modules(commands.__path__):
        candidate = getattr(importlib.import_module(f"{commands.__name__}.{module.name}"), "COMMAND", None)
        if isinstance(candidate, Command):
            found.append(candidate)
    return sorted(found, key=lambda command: command.name)
