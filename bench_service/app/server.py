"""Serves the application on a socket that is bound before anything else is touched."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager

import uvicorn

from bench_service.app.application import create_app
from bench_service.app.http_protocol import PatientProtocol
from bench_service.app.lifespan import running_services
from bench_service.config import ServiceConfig
from bench_service.config.token import service_token
from bench_service.errors import ConflictError, StoreError
from bench_service.numerics import one_thread
from bench_service.store.metadata import MetadataStore

_BACKLOG = 128
_LAST_ANSWERS_S = 2


class AddressError(ConflictError):
    """The service cannot listen where it was told to."""

    code = "address"


def serve(
    config: ServiceConfig,
    host: str = "127.0.0.1",
    port: int = 8000,
    on_ready: Callable[[str], None] | None = None,
) -> None:
    """Serve until SIGINT or SIGTERM; then every bench is brought to rest and everything stored.

    Parameters
    ----------
    config : ServiceConfig
    host, port : str, int
        Where to listen; port 0 takes a free one.
    on_ready : callable or None
        Called with the address when requests are answered.

    Raises
    ------
    AddressError
        The address cannot be had.
    ConflictError
        Another process has the data directory.
    StoreError, SimulationError
        The data directory cannot be opened; recorder or simulator do not start.
    """
    asyncio.run(_serve_until_signal(config, host, port, on_ready))


@asynccontextmanager
async def running_server(config: ServiceConfig, host: str = "127.0.0.1", port: int = 0) -> AsyncIterator[str]:
    """Serve while the block lasts; gives the address. Raises as `serve`."""
    one_thread()  # inherited by workers and control processes
    with _bound(host, port) as listener:
        url = _url(host, listener.getsockname()[1])
        with _opened(config, url) as store:
            token = service_token(config.data_dir, host)
            async with running_services(config, store, url) as services:
                app = create_app(config, host=host, services=services, token=token)
                server = _Server(_uvicorn_config(app))
                serving = asyncio.create_task(server.serve(sockets=[listener]))
                try:
                    await server.answering(serving)
                    yield url
                finally:
                    server.should_exit = True
                    await serving


async def _serve_until_signal(
    config: ServiceConfig, host: str, port: int, on_ready: Callable[[str], None] | None
) -> None:
    told_to_end = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, told_to_end.set)
    async with running_server(config, host, port) as url:
        if on_ready is not None:
            on_ready(url)
        await told_to_end.wait()


class _Server(uvicorn.Server):
    """Leaves signals alone: uvicorn raises them again before the benches are at rest."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield

    async def answering(self, serving: asyncio.Task[None]) -> None:
        while not self.started and not serving.done():
            await asyncio.sleep(0.005)
        if serving.done():
            await serving
            raise RuntimeError("the HTTP server ended at its start")


def _uvicorn_config(app: object) -> uvicorn.Config:
    return uvicorn.Config(
        app,  # pyright: ignore[reportArgumentType]  # any ASGI application
        lifespan="off",
        log_level="warning",
        access_log=False,
        http=PatientProtocol,
        ws="websockets-sansio",
        ws_max_size=65536,
        server_header=False,
        proxy_headers=False,
        timeout_graceful_shutdown=_LAST_ANSWERS_S,
    )


@contextmanager
def _bound(host: str, port: int) -> Iterator[socket.socket]:
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listener = socket.socket(family, kind)
    except OSError as error:
        raise AddressError(f"cannot listen on {host}: {error.strerror or error}; choose another --host") from error
    with contextlib.closing(listener):
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            # Accepted connections inherit it; without it each answer on a kept connection waits 40 ms for an
            # acknowledgement that the other side delays (Nagle, RFC 896). asyncio sets it itself only where the
            # socket names its protocol, which one made here does not.
            listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            listener.bind(address)
            # Listening at once: a second service on the port must fail here, not after it has found its benches.
            listener.listen(_BACKLOG)
        except OSError as error:
            raise AddressError(
                f"cannot listen on {host}:{port}: {error.strerror or error}; "
                "end the program that has the port, or choose another with --port (0 takes a free one)"
            ) from error
        yield listener


@contextmanager
def _opened(config: ServiceConfig, url: str) -> Iterator[MetadataStore]:
    try:
        store = MetadataStore.open(config.data_dir, url=url)
    except StoreError as error:
        if MetadataStore.holder(config.data_dir) is not None:
            raise ConflictError(error.message) from error
        raise
    with contextlib.closing(store):
        yield store


def _url(host: str, port: int) -> str:
    shown = {"0.0.0.0": "127.0.0.1", "::": "[::1]", "": "127.0.0.1"}.get(host, host)  # noqa: S104
    return f"http://{f'[{shown}]' if ':' in shown and not shown.startswith('[') else shown}:{port}"
