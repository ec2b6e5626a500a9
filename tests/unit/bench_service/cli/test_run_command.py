"""Ctrl-C during `bench-service run`: wherever it comes, the run is stopped and its end waited for."""

import os
import signal
from argparse import Namespace
from contextlib import nullcontext
from typing import Any, cast

import pytest

from bench_service.cli.commands.run import _interruptible, _play
from bench_service.client import ClientError

OPTIONS = Namespace(bench="sim", dt=1.0, initial_soc=0.5, resume=None, on_interruption=None)
RUNNING, STOPPED, COMPLETED = ({"id": "r", "state": state} for state in ("running", "stopped", "completed"))


def interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)


class InADestructor:
    """What is raised there is told on the error output, and lost."""

    def __del__(self) -> None:
        interrupt()


class Service:
    """Runs a profile for as long as nobody stops it; `at` says when the person interrupts."""

    def __init__(self, at: str) -> None:
        self.at, self.calls = at, list[str]()

    def start_run(self, *_: Any, **__: Any) -> dict[str, Any]:
        self.calls.append("start")
        if self.at == "start":
            interrupt()
        if self.at == "refused":
            raise ClientError("the bench has a run")
        return RUNNING

    def stop_run(self, _run_id: str) -> None:
        self.calls.append("stop")

    def wait_run(self, _run_id: str, on_progress: Any = None, **_: Any) -> dict[str, Any]:
        if on_progress is None:
            return STOPPED
        for _look in range(3):
            on_progress(RUNNING, None)
            if self.at == "look":
                interrupt()
            if self.at == "destructor":
                InADestructor()
        if self.at == "end":
            interrupt()
        on_progress(COMPLETED, None)
        return COMPLETED


class Profile:
    name, shortest_s = "pulse", 1.0

    def upload(self, *_: Any) -> tuple[str, dict[str, Any]]:
        return "p", {}


class Terminal:
    def progress(self, _title: str) -> Any:
        return nullcontext(lambda *_: None)


@pytest.mark.parametrize(
    ("at", "calls", "ends"),
    [
        ("start", ["start", "stop"], "stopped"),
        ("look", ["start", "stop"], "stopped"),
        ("destructor", ["start", "stop"], "stopped"),
        ("end", ["start"], "completed"),
        ("never", ["start"], "completed"),
    ],
)
def test_a_run_that_was_begun_is_stopped_wherever_the_interruption_comes(at: str, calls: list[str], ends: str) -> None:
    service = Service(at)
    with _interruptible() as interrupts:
        run = _play(cast(Any, service), cast(Any, Profile()), OPTIONS, cast(Any, Terminal()), interrupts)
    assert (service.calls, run["state"]) == (calls, ends)


@pytest.mark.parametrize("refused", [False, True])
def test_once_a_run_is_over_or_was_refused_an_interruption_ends_the_command_at_once(refused: bool) -> None:
    service = Service("refused" if refused else "never")
    with _interruptible() as interrupts:
        with pytest.raises(ClientError) if refused else nullcontext():
            _play(cast(Any, service), cast(Any, Profile()), OPTIONS, cast(Any, Terminal()), interrupts)
        with pytest.raises(KeyboardInterrupt):
            interrupt()


def test_before_a_run_is_begun_and_the_second_time_an_interruption_ends_the_command_at_once() -> None:
    with _interruptible() as interrupts:
        with pytest.raises(KeyboardInterrupt):
            interrupt()
        with interrupts.kept():
            interrupt()
            assert interrupts.asked
            with pytest.raises(KeyboardInterrupt):
                interrupt()
