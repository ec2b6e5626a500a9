"""The service that a command talks to: the one that holds the store, else one of its own for as long as it runs."""

from __future__ import annotations

import asyncio
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from bench_service.cli.errors import UsageError
from bench_service.client import BenchClient
from bench_service.config.token import read_token
from bench_service.store.metadata import MetadataStore

if TYPE_CHECKING:
    from bench_service.config import ServiceConfig

_START_TIMEOUT_S = 60.0
_BENCH_TIMEOUT_S = 20.0
_ACKNOWLEDGE_TIMEOUT_S = 5.0
_LOOK_S = 0.05


@contextmanager
def connected(config: ServiceConfig, bench: str) -> Iterator[BenchClient]:
    """Give a client of a service that has the bench, once the bench is there.

    A service of its own stays on this machine, on a free port, with this bench alone; leaving ends it after every
    sample has been stored.

    Raises
    ------
    UsageError
        The configuration has no such bench.
    ConflictError
        A process that does not answer holds the store.
    """
    holder = MetadataStore.holder(config.data_dir)
    if holder is not None and holder.url is not None:
        with BenchClient(holder.url, token=read_token(config.data_dir)) as client:
            _await_bench(client, bench)
            yield client
        return
    check_data_dir(config.data_dir)
    if bench not in config.bench:
        raise UsageError(f"unknown bench {bench!r}; the configuration has {', '.join(sorted(config.bench))}")
    with own_service(config.model_copy(update={"bench": {bench: config.bench[bench]}}), bench) as client:
        yield client


@contextmanager
def connected_to_store(config: ServiceConfig) -> Iterator[BenchClient]:
    """Give a client of the service that holds the store, else of one of its own without a bench."""
    holder = MetadataStore.holder(config.data_dir)
    if holder is not None and holder.url is not None:
        with BenchClient(holder.url, token=read_token(config.data_dir)) as client:
            yield client
        return
    check_data_dir(config.data_dir)
    with _OwnService(config.model_copy(update={"bench": {}})) as url, BenchClient(url) as client:
        yield client


def check_data_dir(path: Path) -> None:
    """Refuse a data directory that cannot be one; what goes wrong in a good one later is no bad input.

    Raises
    ------
    UsageError
        It, or what it would be made in, is no directory or not writable.
    """
    there = path.absolute()
    while not there.exists() and there != there.parent:
        there = there.parent
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        why = "is not writable" if there.is_dir() else "is not a directory"
        raise UsageError(f"data directory {path}: {there} {why}; choose another (data_dir, or BENCH_DATA_DIR)")


@contextmanager
def own_service(config: ServiceConfig, bench: str) -> Iterator[BenchClient]:
    """Give a client of a service that this process runs itself, on a free port; leaving ends it safely."""
    with _OwnService(config) as url, BenchClient(url) as client:
        _await_bench(client, bench)
        yield client


def _await_bench(client: BenchClient, bench: str) -> None:
    """Wait for a bench that is just being connected; one that stays away is refused when its run starts."""
    known = [each["name"] for each in client.benches()]
    if bench not in known:
        raise UsageError(f"unknown bench {bench!r}; the service has {', '.join(sorted(known))}")
    deadline_s = time.monotonic() + _BENCH_TIMEOUT_S
    while client.bench(bench)["state"] == "offline" and time.monotonic() < deadline_s:
        time.sleep(_LOOK_S)


def acknowledge(client: BenchClient, bench: str) -> None:
    """Clear a latched fault and wait for that; one whose cause is still there is refused when a run starts."""
    client.acknowledge(bench)
    deadline_s = time.monotonic() + _ACKNOWLEDGE_TIMEOUT_S
    while client.bench(bench)["state"] == "fault" and time.monotonic() < deadline_s:
        time.sleep(_LOOK_S)


class _OwnService:
    """A service in a thread of this process."""

    def __init__(self, config: ServiceConfig) -> None:
        self._config = config
        self._thread = threading.Thread(target=self._main, name="service")
        self._answered = threading.Event()
        self._leaving = False
        self._url: str | None = None
        self._error: BaseException | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._end: asyncio.Event | None = None

    def __enter__(self) -> str:
        """Start, and give the address."""
        try:
            self._thread.start()
            self._answered.wait(_START_TIMEOUT_S)
        except KeyboardInterrupt:
            self._stop()
            raise
        if self._url is None:
            self._stop()
            raise self._error or TimeoutError(f"the service did not start within {_START_TIMEOUT_S:g} s")
        return self._url

    def __exit__(self, *_: object) -> None:
        """Bring the bench to rest, store everything, end."""
        self._stop()

    def _stop(self) -> None:
        self._leaving = True  # before the loop is looked for: a thread that has none yet looks here when it has
        if self._loop is not None and self._end is not None:
            with suppress(RuntimeError):  # the loop has ended by itself
                self._loop.call_soon_threadsafe(self._end.set)
        if self._thread.ident is not None:
            self._thread.join()

    def _main(self) -> None:
        try:
            asyncio.run(self._serve())
        except BaseException as error:  # handed to the thread that waits for the start
            self._error = error
        finally:
            self._answered.set()

    async def _serve(self) -> None:
        # Lazy: fastapi, uvicorn and pydantic take 400 ms.
        from bench_service.app.server import running_server

        self._end, self._loop = asyncio.Event(), asyncio.get_running_loop()
        if self._leaving:
            return
        async with running_server(self._config) as url:
            self._url = url
            self._answered.set()
            await self._end.wait()
