"""All formats there are, found by looking at the modules of this package."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from bench_service.exchange.format import Format


@cache
def formats() -> dict[str, Format]:
    """Return every format by name; a module with a constant ``FORMAT`` is one."""
    found: dict[str, Format] = {}
    # By name: the package's front door imports this module.
    package = importlib.import_module(__name__.rpartition(".")[0])
    for module in pkgutil.iter_modules(package.__path__):
        candidate = getattr(importlib.import_module(f"{package.__name__}.{module.name}"), "FORMAT", None)
        if isinstance(candidate, Format):
            if candidate.name in found:
                raise RuntimeError(f"exchange format {candidate.name!r} is defined twice")
            found[candidate.name] = candidate
    return found
