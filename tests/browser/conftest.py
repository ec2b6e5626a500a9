"""Chromium, and pages in it that must stay at home; the address of the service is each module's own fixture."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from urllib.parse import urlsplit

import pytest
from browser_rig import DESKTOP, OpenPage
from playwright.sync_api import Browser, Page, Request, expect, sync_playwright

from tests.patience import PATIENCE_S

_CHROMIUM_ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
# Chromium itself reports each answer that is no success; a refused request is part of some tests.
_REFUSAL = "the server responded with a status of 4"


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    expect.set_options(timeout=1000 * PATIENCE_S)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=_CHROMIUM_ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def open_page(chromium: Browser, address: str) -> Iterator[OpenPage]:
    """Open the page; afterwards nothing may stand in its console, and nothing have gone to another machine."""
    complaints: list[str] = []
    hosts: set[str] = set()

    def note(request: Request) -> None:
        hosts.add(urlsplit(request.url).hostname or "")

    def open_it(
        bench: str, viewport: dict[str, int] = DESKTOP, prepare: Callable[[Page], None] | None = None, path: str = "/"
    ) -> Page:
        context = chromium.new_context(viewport=viewport, timezone_id="Europe/Berlin", reduced_motion="reduce")  # pyright: ignore[reportArgumentType]
        context.set_default_timeout(1000 * PATIENCE_S)
        page = context.new_page()
        page.on("request", note)
        page.on("websocket", lambda socket: hosts.add(urlsplit(socket.url).hostname or ""))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
        if prepare:
            prepare(page)
        page.goto(f"{address}{path}?bench={bench}")
        return page

    yield open_it
    for context in list(chromium.contexts):
        context.close()
    assert [text for text in complaints if _REFUSAL not in text] == []
    assert hosts == {urlsplit(address).hostname}
