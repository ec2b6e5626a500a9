"""The library of standard tests: one JSON file each, with parameters and a sentence on what it is for.

In a file's protocol ``"$name"`` stands for a parameter and ``"-$name"`` for its negative; a step ``each`` is written
out once for every value of a list. Defaults may name what the bench allows: see `bench_values`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.library.filling import bench_values, fill
from bench_service.protocol.program import Window
from bench_service.protocol.steps import SCHEMA


@dataclass(frozen=True, slots=True)
class StandardTest:
    """One standard test.

    Attributes
    ----------
    sentence : str
        What it is for.
    parameters : dict
        ``{name: {"default", "unit", "meaning"}}``; a default that begins with ``$`` is the bench's.
    protocol : dict
        The document, with parameters in place of values.
    """

    name: str
    title: str
    sentence: str
    parameters: Mapping[str, Mapping[str, Any]]
    protocol: Mapping[str, Any]

    def to_json(self) -> dict[str, Any]:
        """Return a JSON object without the protocol."""
        return {
            "name": self.name,
            "title": self.title,
            "sentence": self.sentence,
            "parameters": {name: dict(each) for name, each in self.parameters.items()},
        }

    def values(self, given: Mapping[str, Any], window: Window, capacity_Ah: float) -> dict[str, Any]:
        """Return the value of each parameter: the given one, else its default on this bench.

        Raises
        ------
        ProtocolError
            A parameter is not known, or of another kind than its default.
        """
        bench = bench_values(window, capacity_Ah)
        found: dict[str, Any] = {}
        for name, each in self.parameters.items():
            found[name] = fill(each["default"], bench)
        for name, value in given.items():
            if name not in found:
                known = ", ".join(sorted(found))
                raise ProtocolError(
                    f"{self.name} has no such parameter", ("parameters", name), remedy=f"known: {known}"
                )
            found[name] = _checked(name, value, found[name])
        return found


@cache
def standard_tests() -> tuple[StandardTest, ...]:
    """Return the tests of the library by name."""
    files = {file.name: file for file in resources.files(__name__).iterdir() if file.name.endswith(".json")}
    return tuple(StandardTest(**json.loads(files[name].read_text(encoding="utf-8"))) for name in sorted(files))


def standard_test(name: str) -> StandardTest:
    """Return one test; raises `ProtocolError` where there is none of that name."""
    for test in standard_tests():
        if test.name == name:
            return test
    known = ", ".join(test.name for test in standard_tests())
    raise ProtocolError("no such standard test", ("standard_test",), value=name, remedy=f"choose from {known}")


def build_test(name: str, given: Mapping[str, Any], window: Window, capacity_Ah: float) -> dict[str, Any]:
    """Return the document of a standard test for a bench.

    Parameters
    ----------
    name : str
    given : mapping
        Parameters that differ from their defaults.
    window : Window
        Limits of the bench.
    capacity_Ah : float
        Of its cell.
    """
    test = standard_test(name)
    values = test.values(given, window, capacity_Ah)
    made = fill(test.protocol, bench_values(window, capacity_Ah) | values)
    meta = {"standard_test": {"name": name, "parameters": values}}
    return {"schema": SCHEMA, "name": test.title, "description": test.sentence, **made, "meta": meta}


def _checked(name: str, value: Any, default: Any) -> Any:
    where = ("parameters", name)
    numbers = isinstance(value, int | float) and not isinstance(value, bool)
    if isinstance(default, list):
        if not isinstance(value, list) or not value:
            raise ProtocolError("a list is needed", where, value=value)
    elif isinstance(default, int) and not isinstance(default, bool):
        if not numbers or value != int(value) or value < 1:
            raise ProtocolError("a whole number of at least 1 is needed", where, value=value)
    elif not numbers:
        raise ProtocolError("a number is needed", where, value=value)
    return value
