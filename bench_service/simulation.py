"""Starts a simulator as a process of its own, as everything but the command line must.

The simulator runs below a guard (`python -m bench_service.simulation ARGUMENTS`), which ends it when the service says
so, and a little later when the service has died: until then the control process can still bring it to rest.
"""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import json
import logging
import os
import selectors
import signal
import subprocess
import sys
from collections.abc import Sequence

_log = logging.getLogger(__name__)
_START_TIMEOUT_S = 30.0
_END_TIMEOUT_S = 5.0
_GRACE_S = 10.0
_PR_SET_PDEATHSIG = 1  # linux/prctl.h


class SimulationError(RuntimeError):
    """The simulator did not start; the message holds its own words."""


class SimulatorProcess:
    """A running simulator; made by `start`."""

    def __init__(
        self,
        process: asyncio.subprocess.Process,
        address: str,
        late: str | None = None,
        chamber: str | None = None,
    ) -> None:
        self._process = process
        self.address = address
        self.chamber = chamber  # address of the bench's temperature chamber, where it has one
        self.late = late  # why it has no real-time priority, where it should
        # Unread complaints would fill the pipe and stop the simulator in the middle of a run.
        self._listening = asyncio.create_task(self._pass_on_complaints())

    @classmethod
    async def start(cls, arguments: Sequence[str]) -> SimulatorProcess:
        """Start `bench-service simulate` and wait for its address.

        Parameters
        ----------
        arguments : sequence of str
            What follows the name of the command.

        Raises
        ------
        SimulationError
            It ended, or said nothing in time.
        """
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "bench_service.simulation", *arguments, "--json"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is for the service, which first brings its benches to rest
        )
        assert process.stdout is not None and process.stderr is not None  # noqa: S101  # piped above
        try:
            line = await asyncio.wait_for(process.stdout.readline(), _START_TIMEOUT_S)
            told = json.loads(line)
            return cls(process, told["address"], told.get("reason"), told.get("chamber"))
        except (TimeoutError, ValueError, KeyError) as error:
            words = await _last_words(process)
            raise SimulationError(f"the simulator did not start: {words or 'it gave no address'}") from error

    @property
    def pid(self) -> int:
        """Process id of the guard."""
        return self._process.pid

    async def wait(self) -> None:
        """Wait until it has ended, by whatever cause."""
        await self._process.wait()

    async def _pass_on_complaints(self) -> None:
        assert self._process.stderr is not None  # noqa: S101  # piped at the start
        async for line in self._process.stderr:
            _log.warning("simulator: %s", line.decode(errors="replace").rstrip())

    async def stop(self) -> None:
        """End it and wait for its end; harmless if it has ended."""
        if self._process.returncode is None:
            await self._end()
        await self._listening

    async def _end(self) -> None:
        assert self._process.stdin is not None  # noqa: S101  # piped at the start
        with contextlib.suppress(ConnectionError):
            self._process.stdin.write(b"end\n")
            await self._process.stdin.drain()
        try:
            await asyncio.wait_for(self._process.wait(), 2 * _END_TIMEOUT_S)
        except TimeoutError:
            self._process.kill()
            await self._process.wait()


async def _last_words(process: asyncio.subprocess.Process) -> str:
    try:
        _, words = await asyncio.wait_for(process.communicate(), _END_TIMEOUT_S)
    except TimeoutError:
        process.kill()
        _, words = await process.communicate()
    return (words.decode(errors="replace").strip().splitlines() or [""])[-1]


def main(arguments: Sequence[str]) -> int:
    """Guard one simulator: standard input is the tie to the service."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    command = [sys.executable, "-m", "bench_service.cli", "simulate", *arguments]
    # A simulator whose guard was killed must not keep the address from the next one.
    simulator = subprocess.Popen(command, stdin=subprocess.DEVNULL, preexec_fn=_die_with_guard)  # noqa: PLW1509
    try:
        _watch(simulator)
    finally:
        status = _end(simulator)
    return status


def _die_with_guard() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def _watch(simulator: subprocess.Popen[bytes]) -> None:
    """Return when the simulator has ended, the service says so, or the service has been dead for a while."""
    with selectors.DefaultSelector() as selector:
        ended = os.pidfd_open(simulator.pid)
        selector.register(ended, selectors.EVENT_READ)
        selector.register(0, selectors.EVENT_READ)
        ready = {key.fd for key, _ in selector.select()}
        if ended not in ready and os.read(0, 64) == b"":
            selector.unregister(0)
            selector.select(_GRACE_S)


def _end(simulator: subprocess.Popen[bytes]) -> int:
    simulator.terminate()
    try:
        return simulator.wait(_END_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        simulator.kill()
        return simulator.wait()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
