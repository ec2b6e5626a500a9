"""Commands of `bench-service` as users give them: in a process of their own or in this one, and what they answer."""

import contextlib
import io
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

from bench_service.cli.main import main
from tests.patience import PATIENCE_S

CLI = (sys.executable, "-m", "bench_service.cli")


class Done(NamedTuple):
    """How a command ended and what it said."""

    returncode: int
    stdout: str
    stderr: str


def spawn(*arguments: object, cwd: Path | None = None, timeout_s: float = PATIENCE_S) -> Done:
    """Run a command as a process."""
    environment = {key: value for key, value in os.environ.items() if key != "BENCH_DATA_DIR"}
    done = subprocess.run(
        [*CLI, *map(str, arguments)], capture_output=True, text=True, cwd=cwd, env=environment, timeout=timeout_s
    )
    return Done(done.returncode, done.stdout, done.stderr)


def call(*arguments: object) -> Done:
    """Run a command in this process, which saves the second that a new one needs for its imports."""
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as complaints:
        try:
            status = main([str(each) for each in arguments])
        except SystemExit as ended:
            status = int(ended.code or 0)
    return Done(status, out.getvalue(), complaints.getvalue())


def answer(done: Done) -> dict[str, Any]:
    """The one JSON object of a command that succeeded."""
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") == 1
    return json.loads(done.stdout)


def refusal(done: Done) -> str:
    """The one line of a command that was given bad input."""
    assert done.returncode == 2, f"{done.returncode}: {done.stdout} {done.stderr}"
    assert done.stdout == ""
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    return done.stderr
