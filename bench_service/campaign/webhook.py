"""Tells another program, such as an electronic notebook, of each run that has ended; no bench ever waits for it."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import hmac
import json
import time
from collections.abc import Awaitable, Callable
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from bench_service.bench.messages import EventMessage
from bench_service.campaign.journal import Journal
from bench_service.config import WebhookConfig
from bench_service.errors import NotFoundError, ServiceError
from bench_service.exchange.atomic import write_atomically
from bench_service.exchange.errors import ExchangeError
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import Json, RunRecord, utc_text

FILE = "webhook.json"  # in the data directory: what is not delivered yet
SIGNATURE = "X-Bench-Signature"
_FIRST_PAUSE_S, _LAST_PAUSE_S = 1.0, 300.0
# Answers that may be another one later, beside those of a server in trouble.
_LATER = frozenset({408, 425, 429})
_SERVER_TROUBLE = 500

# Takes address, body and headers; gives the HTTP status, raises where no answer came.
Send = Callable[[str, bytes, dict[str, str]], Awaitable[int]]


class Webhook:
    """Posts each ended run to an address, one after another, until it is taken or too old.

    Parameters
    ----------
    config : WebhookConfig
    data_dir : Path
        Where it keeps what is not delivered yet: that outlives the service.
    store, journal
    told : dict
        What stands in every body: institution and version; ``address`` of this service, or None.
    send : callable or None
        How a request is sent; None: over HTTP.
    """

    def __init__(
        self,
        config: WebhookConfig,
        data_dir: Path,
        store: MetadataStore,
        journal: Journal,
        told: Json,
        send: Send | None = None,
    ) -> None:
        self._config, self._file = config, data_dir / FILE
        self._store, self._journal, self._told = store, journal, told
        self._send = send or self._over_http
        self._waiting: list[Json] = []
        self._news = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._loop = asyncio.get_running_loop()

    async def start(self) -> None:
        """Go on with what an earlier service has left, and hear of every run that ends from now on."""
        self._waiting = await asyncio.to_thread(self._read)
        self._store.runs.on_end = self._heard
        self._task = asyncio.create_task(self._deliver())

    async def close(self) -> None:
        """End; what is not delivered stays for the next service."""
        self._store.runs.on_end = None
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task
        await asyncio.to_thread(self._keep)

    def _heard(self, run: RunRecord) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._take, run.id)

    def _take(self, run_id: str) -> None:
        self._waiting.append({"run_id": run_id, "since_s": time.time()})
        self._news.set()

    async def _deliver(self) -> None:
        pause_s, told = _FIRST_PAUSE_S, False
        while True:
            await asyncio.to_thread(self._keep)
            if not self._waiting:
                self._news.clear()
                await self._news.wait()
                continue
            entry = self._waiting[0]
            problem, again = await self._try(entry["run_id"])
            too_old = time.time() - entry["since_s"] > 3600.0 * self._config.retry_h
            if problem is None or not again or too_old:
                self._waiting.pop(0)
                self._tell_end(entry["run_id"], problem, failed_before=told)
                pause_s, told = _FIRST_PAUSE_S, False
                continue
            if not told:
                told = True
                self._note(entry["run_id"], "warning", f"{problem}; it is tried again for {self._config.retry_h:g} h")
            await asyncio.sleep(pause_s)
            pause_s = min(_LAST_PAUSE_S, 2.0 * pause_s)

    async def _try(self, run_id: str) -> tuple[str | None, bool]:
        """Return what went wrong, None where nothing did, and whether it may go better later."""
        try:
            body = await asyncio.to_thread(self._body, run_id)
        except (NotFoundError, ValueError) as error:  # the run is gone, or holds what JSON has no word for
            return str(error), False
        except ServiceError as error:  # a store that cannot be read now: no reason to give up all that comes after
            return str(error), True
        try:
            status = await self._send(self._config.url, body, self._headers(body))
        except Exception as error:  # whatever the network and another program make of it
            return f"no answer: {error or type(error).__name__}", True
        if 200 <= status < 300:
            return None, False
        return f"the answer was {status}", status >= _SERVER_TROUBLE or status in _LATER

    def _body(self, run_id: str) -> bytes:
        run = self._store.runs.get(run_id)
        cell = None if run.cell_id is None else asdict(self._store.cells.get(run.cell_id))
        address = self._told["address"] or ""
        links = {"page": f"{address}/runs/{run.id}", "bundle": f"{address}/api/v1/runs/{run.id}/export?format=ro-crate"}
        told = {key: self._told[key] for key in ("institution", "version")}
        sent = {"event": "run_ended", "sent_utc": utc_text(datetime.now(UTC)), **told}
        return json.dumps(sent | {"run": asdict(run), "cell": cell, "links": links}, allow_nan=False).encode()

    def _headers(self, body: bytes) -> dict[str, str]:
        headers = {"Content-Type": "application/json", "User-Agent": f"bench-service/{self._told['version']}"}
        if self._config.secret is not None:
            headers[SIGNATURE] = signature(self._config.secret, body)
        if self._config.token is not None:
            headers["Authorization"] = f"Bearer {self._config.token}"
        return headers

    async def _over_http(self, url: str, body: bytes, headers: dict[str, str]) -> int:
        # Lazy: httpx takes 60 ms, and most services have no webhook.
        import httpx

        # As for the client: a proxy from the environment does not stand in between; nor is a redirection followed.
        async with httpx.AsyncClient(timeout=self._config.timeout_s, trust_env=False) as client:
            return (await client.post(url, content=body, headers=headers)).status_code

    def _tell_end(self, run_id: str, problem: str | None, *, failed_before: bool) -> None:
        if problem is not None:
            self._note(run_id, "error", f"{problem}; it is not tried again")
        elif failed_before:
            self._note(run_id, "info", "it was taken now")

    def _note(self, run_id: str, severity: str, text: str) -> None:
        parts = urlsplit(self._config.url)  # what else stands in it may be a secret
        said = f"webhook {parts.scheme}://{parts.hostname}, run {run_id[:8]}: {text}"
        self._journal.note(None, EventMessage(severity=severity, code="webhook", text=said, run_id=run_id))

    def _read(self) -> list[Json]:
        try:
            found: Any = json.loads(self._file.read_text())
        except (OSError, ValueError):
            return []
        return [each for each in found if isinstance(each, dict) and {"run_id", "since_s"} <= set(each)]

    def _keep(self) -> None:
        if self._waiting or self._file.exists():
            with contextlib.suppress(ExchangeError):  # a full disk: it is tried from memory
                write_atomically(self._file, json.dumps(self._waiting).encode())


def signature(secret: str, body: bytes) -> str:
    """Return what the header of a signed body says."""
    return "sha256=" + hmac.new(secret.encode(), body, hashlib.sha256).hexdigest()
