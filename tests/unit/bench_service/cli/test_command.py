"""Finding commands: one that cannot be imported stands in nobody else's way."""

from pathlib import Path

import pytest

from bench_service.cli import commands
from bench_service.cli.command import find_commands


def test_a_command_has_the_name_of_its_module() -> None:
    for command in find_commands():
        assert [found.name for found in find_commands(command.name)] == [command.name]


def test_a_broken_command_breaks_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "aaa_broken.py").write_text("raise ImportError('half written')\n")
    monkeypatch.setattr(commands, "__path__", [*commands.__path__, str(tmp_path)])
    assert [found.name for found in find_commands("simulate")] == ["simulate"]
    with pytest.raises(ImportError, match="half written"):
        find_commands("aaa-broken")


def test_an_unknown_or_absent_command_lists_all() -> None:
    names = {found.name for found in find_commands()}
    assert {"simulate", "serve", "run"} <= names
    assert {found.name for found in find_commands("nonsense")} == names
