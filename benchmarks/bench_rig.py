"""A whole service and a simulated cycler that tells when its output is switched, each in a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from bench_service.client import BenchClient, ClientError

PATIENCE_S = 60.0
PRESSED_S = 0.5
BENCH = "cell"
PRIORITY = 9


class ToldSimulator:
    """A simulated cycler in a process of its own that tells when its output is switched."""

    def __init__(self, transport: str) -> None:
        self._switched: list[tuple[bool, float]] = []
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.bench_rig", transport],
            stdout=subprocess.PIPE,
            stdin=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        self.url = json.loads(self._process.stdout.readline())["address"]
        threading.Thread(target=self._listen, daemon=True).start()

    def __enter__(self) -> ToldSimulator:
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            told = json.loads(line)
            self._switched.append((told["output"], told["time_s"]))

    @property
    def output_on(self) -> bool:
        """Whether the output is on, by what was told last."""
        return bool(self._switched) and self._switched[-1][0]

    @property
    def last_switched_s(self) -> float | None:
        """When it was switched last, by the machine's monotonic clock."""
        return self._switched[-1][1] if self._switched else None

    def push_button(self) -> None:
        """Press the button that is wired to the cycler; it comes back by itself."""
        assert self._process.stdin is not None
        self._process.stdin.write("press\n")
        self._process.stdin.flush()

    def await_output(self, on: bool) -> float | None:
        """Return when the output was last switched so; None if it is not within the patience."""
        end_s = time.monotonic() + PATIENCE_S
        while not self._switched or self._switched[-1][0] is not on:
            if time.monotonic() > end_s:
                return None
            time.sleep(0.001)
        return self._switched[-1][1]


def table_of(url: str, transport: str) -> str:
    """Configuration of a bench whose cycler is a told simulator."""
    device_map = "generic_can" if transport == "can" else "generic"
    return (
        f"[bench.{BENCH}]\nurl = '{url}'\nmap = '{device_map}'\ncapacity_Ah = 2.5\n"
        "limits = { voltage_V = [2.5, 4.2], current_A = [-10, 5], temperature_degC = [-20, 60], duration_s = 36000 }\n"
    )


class ServiceProcess:
    """`bench-service serve` over a folder; may be killed and started again."""

    def __init__(self, folder: Path, benches: str) -> None:
        self.data, self.config, self._log = folder / "data", folder / "bench.toml", folder / "log"
        self.config.write_text(f"data_dir = '{self.data}'\n{benches}")
        self.start()

    def start(self) -> None:
        """Start it and wait for its address."""
        command = [sys.executable, "-m", "bench_service.cli", "serve", "--json", "--port", "0"]
        with self._log.open("a") as log:
            self.process = subprocess.Popen(
                [*command, "--config", str(self.config)], stdout=subprocess.PIPE, stderr=log, text=True
            )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, self._log.read_text()
        self.address: str = json.loads(line)["address"]
        self.client = BenchClient(self.address, timeout_s=PATIENCE_S)

    def kill(self) -> None:
        """Kill it; what it has started is left to itself."""
        self.process.kill()
        self.process.wait()
        self.client.close()

    def until(self, condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> Any:
        """Look until something holds, and give it; a service that is starting or flooded does not answer."""
        end_s, last = time.monotonic() + patience_s, None
        while time.monotonic() < end_s:
            try:
                if found := condition():
                    return found
            except ClientError as error:
                last = error
            time.sleep(0.05)
        raise RuntimeError(f"not within {patience_s:g} s: {what} ({last})")

    def idle(self, bench: str) -> bool:
        """Whether a bench is idle; acknowledges its fault, if it has one."""
        state = self.client.bench(bench)["state"]
        if state == "fault":
            self.client.acknowledge(bench)
        return state == "idle"

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Tell it to end, and wait."""
        self.client.close()
        self.process.terminate()
        self.process.wait(PATIENCE_S)


def children(pid: int) -> list[int]:
    """Processes that a process has started, from any of its threads."""
    lists = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for each in lists for child in each.read_text().split()]


def command_of(pid: int) -> str:
    """Command line of a process, empty where it has just gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def main() -> int:
    """Be the simulator: print its address, then each switch of its output."""
    from bench_service.bench.realtime import real_time_priority
    from simulators.bench import SimulatorSettings, serve
    from simulators.cycler import Cycler

    switch, made = Cycler.set_output, Cycler.__init__

    def told(self: Cycler, on: bool) -> None:
        before = self.output_on
        switch(self, on)
        if on != before:
            _say({"output": on, "time_s": time.monotonic()})

    def init(self: Cycler, *arguments: Any, **named: Any) -> None:
        made(self, *arguments, **named)
        threading.Thread(target=_buttons, args=(self,), daemon=True).start()

    Cycler.set_output, Cycler.__init__ = told, init
    transport = sys.argv[1]
    device_map = "generic_can" if transport == "can" else "generic"
    settings = SimulatorSettings(protocol=transport, map_name=device_map, lock_step=False, seed=7)
    with contextlib.suppress(KeyboardInterrupt), real_time_priority(PRIORITY):  # as `bench-service simulate` does
        asyncio.run(serve(settings, lambda address: _say({"address": address})))
    return 0


def _say(what: dict[str, Any]) -> None:
    print(json.dumps(what), flush=True)  # noqa: T201


def _buttons(cycler: Any) -> None:
    for _ in sys.stdin:
        cycler.stop_input = True
        time.sleep(PRESSED_S)
        cycler.stop_input = False


if __name__ == "__main__":
    raise SystemExit(main())
