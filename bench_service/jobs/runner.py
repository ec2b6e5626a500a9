"""Runs module-level functions in worker processes and keeps a record of each."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import multiprocessing
import multiprocessing.connection
import os
import shutil
import signal
import socket
import tempfile
import threading
import uuid
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Concatenate

from threadpoolctl import threadpool_limits

from bench_service.errors import NotFoundError, ServiceError
from bench_service.jobs.progress import Report, Reporter, ReportListener

_log = logging.getLogger(__name__)
WORKER_DIED = "the worker process died"
_KEPT_JOBS = 500
# What a person waits for in front of a page, seconds of work: it has a worker of its own, so that it does not stand
# behind a fit of minutes.
QUICK_KINDS = frozenset({"comparison", "series", "where", "report", "tables", "import"})

JobFunction = Callable[Concatenate[Reporter, ...], Mapping[str, Any]]
# Takes what a job gave in the worker, gives what is told of it.
Keep = Callable[[Any], Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class Job:
    """Record of one job; ``result`` is a JSON object, ``error`` one line for a person."""

    id: str
    kind: str
    state: str = "queued"
    progress: float = 0.0
    message: str = ""
    result: Mapping[str, Any] | None = None
    error: str | None = None

    @property
    def ended(self) -> bool:
        """Whether nothing more will happen to it."""
        return self.state in ("done", "failed")


class JobRunner:
    """A fixed number of worker processes, each started anew when it has died.

    Parameters
    ----------
    workers : int
        Long jobs at the same time; each worker has one BLAS thread and the lowest priority. One worker more takes the
        jobs of `QUICK_KINDS`.
    on_change : callable or None
        Called with the record at each change, in the event loop.
    """

    def __init__(self, workers: int = 1, on_change: Callable[[Job], None] | None = None, nice: int = 19) -> None:
        self._workers, self._nice = workers, nice
        self._on_change = on_change
        self._jobs: dict[str, Job] = {}
        self._tasks: dict[str, asyncio.Task[Job]] = {}
        self._pids: dict[str, int] = {}
        self._at_work: set[str] = set()  # in a worker now
        self._storing: set[str] = set()  # what was made is being stored
        self._free: asyncio.Queue[ProcessPoolExecutor] = asyncio.Queue()
        self._free_quick: asyncio.Queue[ProcessPoolExecutor] = asyncio.Queue()
        self._directory: Path | None = None
        self._transport: asyncio.DatagramTransport | None = None

    async def start(self) -> None:
        """Open the channel for progress; a worker process starts with its first job."""
        self._directory = Path(tempfile.mkdtemp(prefix="bench-jobs-"))
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        listener.bind(self._path)
        self._transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: ReportListener(self._take_report), sock=listener
        )
        for _ in range(self._workers):
            self._free.put_nowait(_new_worker(self._nice))
        self._free_quick.put_nowait(_new_worker(self._nice))

    async def stop(self) -> None:
        """End all jobs and workers; jobs under way become ``failed``."""
        for job_id in list(self._tasks):
            self.cancel(job_id)
        await asyncio.gather(*self._tasks.values(), return_exceptions=True)
        for free in (self._free, self._free_quick):
            while not free.empty():
                free.get_nowait().shutdown(wait=True, cancel_futures=True)
        if self._transport is not None:
            self._transport.close()
        if self._directory is not None:
            shutil.rmtree(self._directory, ignore_errors=True)

    def submit(
        self,
        kind: str,
        function: JobFunction,
        *arguments: object,
        store: Keep | None = None,
    ) -> Job:
        """Queue a job.

        Parameters
        ----------
        kind : str
            What it is, for people: ``"fit"``, ``"comparison"``.
        function : callable
            Module-level function ``(report, *arguments) -> JSON object``; it and its arguments are pickled
            on the way to the worker, never to disk.
        store : callable or None
            Called in a thread of the service with the function's result; gives the record's ``result``. Whoever keeps
            what a job made does it here, before the job is ``done``.
        """
        job = Job(uuid.uuid4().hex, kind)
        self._set(job)
        self._tasks[job.id] = asyncio.create_task(self._run(job.id, function, arguments, store))
        self._forget_oldest()
        return job

    def get(self, job_id: str) -> Job:
        """Give the record; raises `NotFoundError`."""
        if job_id not in self._jobs:
            raise NotFoundError.of("job", job_id)
        return self._jobs[job_id]

    async def wait(self, job_id: str) -> Job:
        """Wait until the job has ended and give its record; cancelling the wait leaves the job."""
        job = self.get(job_id)
        task = self._tasks.get(job_id)
        return job if task is None else await asyncio.shield(task)

    def cancel(self, job_id: str) -> None:
        """End a job: a queued one is dropped, a running one's worker is killed.

        Nothing happens when it has ended, and while what it made is being stored: that is done to its end.
        """
        job = self.get(job_id)
        if job.ended or job_id in self._storing:
            return
        self._set(replace(job, state="failed", error="cancelled"))
        if (pid := self._pids.get(job_id)) is not None:
            _kill(pid)

    @property
    def _path(self) -> str:
        if self._directory is None:
            raise RuntimeError("the job runner is not started")
        return str(self._directory / "progress")

    async def _run(
        self,
        job_id: str,
        function: JobFunction,
        arguments: tuple[object, ...],
        store: Keep | None,
    ) -> Job:
        free = self._free_quick if self._jobs[job_id].kind in QUICK_KINDS else self._free
        worker = await free.get()
        try:
            if not self._jobs[job_id].ended:
                result = await self._work(worker, job_id, function, arguments)
                if self._jobs[job_id].ended:  # cancelled in its last moment: the kill may hit the worker later
                    worker.shutdown(wait=False)
                    worker = _new_worker(self._nice)
                else:
                    self._storing.add(job_id)
                    result = result if store is None else await asyncio.to_thread(store, result)
                    self._set(replace(self._jobs[job_id], state="done", progress=1.0, result=result))
        except BrokenProcessPool:
            worker.shutdown(wait=False)
            worker = _new_worker(self._nice)
            self._fail(job_id, f"{WORKER_DIED}; see the service's log, and try fewer or smaller runs")
        except Exception as error:  # whatever a job does, the service goes on
            if not isinstance(error, ServiceError | ValueError):
                _log.exception("job %s failed", job_id)
            self._fail(job_id, str(error) or type(error).__name__)
        finally:
            free.put_nowait(worker)
            self._storing.discard(job_id)
            self._tasks.pop(job_id, None)
        return self._jobs[job_id]

    async def _work(
        self, worker: ProcessPoolExecutor, job_id: str, function: JobFunction, arguments: tuple[object, ...]
    ) -> Mapping[str, Any]:
        self._set(replace(self._jobs[job_id], state="running"))
        reporter = Reporter(self._path, job_id)
        self._at_work.add(job_id)
        try:
            return await asyncio.wrap_future(worker.submit(_call, function, reporter, arguments))
        finally:
            self._at_work.discard(job_id)
            self._pids.pop(job_id, None)

    def _fail(self, job_id: str, error: str) -> None:
        if not self._jobs[job_id].ended:
            self._set(replace(self._jobs[job_id], state="failed", error=error))

    def _take_report(self, report: Report) -> None:
        job = self._jobs.get(report["job"])
        if job is None or job.id not in self._tasks:
            return
        if job.id in self._at_work:
            self._pids[job.id] = int(report["pid"])
            if job.ended:  # cancelled before its worker had told its pid
                _kill(self._pids[job.id])
        if job.ended:
            return
        fraction = min(max(float(report["fraction"]), job.progress), 1.0)
        self._set(replace(job, progress=fraction, message=str(report["message"]) or job.message))

    def _set(self, job: Job) -> None:
        self._jobs[job.id] = job
        if self._on_change is not None:
            self._on_change(job)

    def _forget_oldest(self) -> None:
        for job_id in list(self._jobs)[: max(0, len(self._jobs) - _KEPT_JOBS)]:
            if self._jobs[job_id].ended:
                del self._jobs[job_id]


def _new_worker(nice: int) -> ProcessPoolExecutor:
    # spawn: a fork of a process with threads and an event loop can hang in a lock it copied.
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(1, mp_context=context, initializer=settle_worker, initargs=(nice,))


def _kill(pid: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def settle_worker(nice: int) -> None:
    """Make a worker process polite, and end it with the service."""
    os.nice(nice)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to the whole group; the service ends its workers
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    # A killed parent never closes the pool's queue, which the worker holds open itself.
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)


def _call(function: JobFunction, reporter: Reporter, arguments: tuple[object, ...]) -> Mapping[str, Any]:
    reporter(0.0)
    with threadpool_limits(limits=1):
        return function(reporter, *arguments)
