"""The service as users start it, in a process of its own, for tests that talk to it over HTTP."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bench_service.client import BenchClient, ClientError
from tests.patience import PATIENCE_S


class Service:
    """One `bench-service serve`."""

    def __init__(self, directory: Path, benches: str, *, workers: int = 1, port: int = 0) -> None:
        self.data_dir = directory / "data"
        config = directory / "bench.toml"
        config.write_text(f"data_dir = '{self.data_dir}'\nworkers = {workers}\n{benches}\n")
        arguments = ["serve", "--json", "--config", str(config), "--port", str(port)]
        environment = {name: value for name, value in os.environ.items() if name != "BENCH_DATA_DIR"}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "bench_service.cli", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise AssertionError(f"the service did not start: {self.end()}")
        self.url: str = json.loads(line)["address"]
        self.client = BenchClient(self.url)

    def idle(self, bench: str) -> dict[str, Any]:
        return until(lambda: (found := self.client.bench(bench))["state"] == "idle" and found, f"{bench} idle")

    def end(self, number: signal.Signals = signal.SIGTERM) -> tuple[int, str]:
        """End it and give its exit status and what it said on standard error."""
        if hasattr(self, "client"):
            self.client.close()
        if self.process.poll() is None:
            self.process.send_signal(number)
        _, words = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, words


@contextmanager
def serving(directory: Path, benches: str) -> Iterator[Service]:
    """A service whose bench `sim` is idle; Ctrl-C ends it at last, and it must have had nothing to complain of."""
    service = Service(directory, benches)
    try:
        service.idle("sim")
        yield service
    finally:
        assert service.end(signal.SIGINT) == (0, "")


def until(condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> Any:
    """Look until something holds; a service that is just starting or ending does not answer."""
    end_s = time.monotonic() + patience_s
    last: object = None
    while time.monotonic() < end_s:
        try:
            if found := condition():
                return found
        except ClientError as error:
            last = error
        time.sleep(0.02)
    raise AssertionError(f"not within {patience_s:g} s: {what} ({last})")


def hardware(name: str, url: str) -> str:
    """Configuration of a bench whose cycler is at an address."""
    return (
        f"[bench.{name}]\nurl = '{url}'\ncapacity_Ah = 2.5\n"
        "limits = { voltage_V = [2.5, 4.2], current_A = [-10, 5], temperature_degC = [-20, 60], duration_s = 36000 }\n"
    )
