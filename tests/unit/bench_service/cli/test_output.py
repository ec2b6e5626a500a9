"""What commands print."""

import json
from pathlib import Path

import numpy as np
import pytest

from bench_service.cli import commands
from bench_service.cli.command import find_commands
from bench_service.cli.output import Output


def test_json_is_one_object_of_plain_values(capsys: pytest.CaptureFixture[str]) -> None:
    data = {"a": np.float64(0.5), "b": np.arange(2), "c": (float("nan"), np.inf), "d": {"e": np.int64(1)}, "f": None}
    Output(as_json=True).result(data, lambda console: console.print("table"))
    captured = capsys.readouterr()
    assert json.loads(captured.out) == {"a": 0.5, "b": [0, 1], "c": [None, None], "d": {"e": 1}, "f": None}
    assert captured.out.count("\n") == 1
    assert captured.err == ""


def test_warnings_come_once_and_with_the_result(capsys: pytest.CaptureFixture[str]) -> None:
    output = Output(as_json=False)
    output.warn("look out", "look out")
    assert capsys.readouterr() == ("", "")
    output.result({}, lambda console: console.print("table"))
    assert capsys.readouterr() == ("table\n", "warning: look out\n")


def test_no_bar_where_nobody_watches(capsys: pytest.CaptureFixture[str]) -> None:
    with Output(as_json=False).progress("Working") as report:
        report(0.5, "half")
    assert capsys.readouterr() == ("", "")


def test_every_module_of_the_commands_is_one() -> None:
    modules = [path for path in Path(commands.__path__[0]).glob("*.py") if path.stem != "__init__"]
    found = find_commands()
    assert len(found) == len(modules) > 0
    assert len({command.name for command in found}) == len(found)
