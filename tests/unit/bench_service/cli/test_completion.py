"""What a shell asks for when the tabulator key is pressed, asked by bash itself."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

_ASK = """
source <("$BENCH_SERVICE" completion bash)
COMP_LINE=$1 COMP_POINT=${#1} COMP_TYPE=9 COMP_WORDS=($1)
[[ $1 == *" " ]] && COMP_WORDS+=("")
COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
_python_argcomplete "${COMP_WORDS[0]}"
printf '%s\\n' "${COMPREPLY[@]}"
"""
_PROGRAM = Path(sys.executable).with_name("bench-service")


def completions(line: str) -> set[str]:
    path = f"{_PROGRAM.parent}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"BENCH_SERVICE": str(_PROGRAM), "PATH": path}
    asked = subprocess.run(
        ["bash", "-c", _ASK, "ask", line], capture_output=True, text=True, env=environment, timeout=120, check=True
    )
    return {word.strip() for word in asked.stdout.split("\n") if word.strip()}


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("bench-service fi", {"fit"}),
        ("bench-service fit --str", {"--structure"}),
        ("bench-service demo --cell ", {"nmc", "lfp", "nimh"}),
        ("bench-service completion ", {"bash", "zsh", "fish"}),
    ],
)
def test_commands_options_and_choices_are_offered(line: str, offered: set[str]) -> None:
    assert offered <= completions(line)
    assert "serve" not in completions(line)


def test_files_are_offered_where_a_file_is_wanted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "measured.csv").touch()
    monkeypatch.chdir(tmp_path)
    assert completions("bench-service fit mea") == {"measured.csv"}


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_gets_its_script(shell: str) -> None:
    printed = subprocess.run([_PROGRAM, "completion", shell], capture_output=True, text=True, timeout=120, check=True)
    assert "bench-service" in printed.stdout and printed.stderr == ""
