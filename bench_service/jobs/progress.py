"""How a worker tells the service how far it is: datagrams, which neither side ever waits for."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypedDict

_LONGEST_MESSAGE = 500


class Report(TypedDict):
    """How far a job is, as it comes from its worker process."""

    job: str
    pid: int
    fraction: float
    message: str


@dataclass(frozen=True, slots=True)
class Reporter:
    """Handed to a job's function as its first argument; travels to the worker process.

    Parameters
    ----------
    path : str
        Datagram socket of the service.
    job_id : str
        The job that reports.
    """

    path: str
    job_id: str

    def __call__(self, fraction: float, message: str = "") -> None:
        """Report the share done, 0..1, and what is being done; lost rather than waited for."""
        report = Report(job=self.job_id, pid=os.getpid(), fraction=fraction, message=message[:_LONGEST_MESSAGE])
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as link:
            link.setblocking(False)
            link.sendto(json.dumps(report).encode(), self.path)


class ReportListener(asyncio.DatagramProtocol):
    """Service end of `Reporter`; calls back with each well-formed report."""

    def __init__(self, on_report: Callable[[Report], None]) -> None:
        self._on_report = on_report

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Take one report in; anything else is ignored."""
        with contextlib.suppress(ValueError, KeyError, TypeError):
            self._on_report(json.loads(data))
