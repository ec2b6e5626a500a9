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


def find_commands(wanted: str | None = None) -> list[Command]:
    """Return the wanted command, or all of them, by name. Modules import what is slow to import when they run.

    The module of a command has its name, with ``_`` for ``-`` (and one behind a word of Python's own). Only the wanted
    one is imported: one that cannot be must not stand in the way of the others, of `simulate` in a running service
    least of all.
    """
    names = [module.name for module in pkgutil.iter_modules(commands.__path__)]
    module_name = (wanted or "").replace("-", "_")
    asked = [name for name in (module_name, f"{module_name}_") if name in names]
    found = []
    for name in asked or names:
        candidate = getattr(importlib.import_module(f"{commands.__name__}.{name}"), "COMMAND", None)
        if isinstance(candidate, Command):
            found.append(candidate)
    return sorted(found, key=lambda command: command.name)
