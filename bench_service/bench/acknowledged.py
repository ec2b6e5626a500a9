"""A fault that somebody has acknowledged: told again where the process that was told has died before it could act."""

import subprocess

from bench_service.bench.listener import BenchStatus

Process = subprocess.Popen[bytes] | None


class Acknowledged:
    """What was acknowledged last, and which control process was told so."""

    def __init__(self) -> None:
        self._told: tuple[str | None, Process] | None = None

    def told(self, reason: str | None, process: Process) -> None:
        """Note that a process was told that the fault with this reason is acknowledged."""
        self._told = (reason, process)

    def done(self) -> None:
        """Note that it was heard."""
        self._told = None

    def unheard(self, status: BenchStatus, process: Process) -> bool:
        """Whether a process has to be told again; forgets what does not hold any more."""
        if self._told is None:
            return False
        reason, told = self._told
        if status.state != "fault" or status.reason != reason:
            self._told = None
        return self._told is not None and told is not process
