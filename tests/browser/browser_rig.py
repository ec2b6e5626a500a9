"""The service in a process of its own, for tests that look at its page."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, WebSocketRoute

from tests.patience import PATIENCE_S

DESKTOP = {"width": 1280, "height": 800}
PHONE = {"width": 390, "height": 844}

OpenPage = Callable[..., Page]


def looked_at(page: Page, name: str) -> None:
    """Nothing in the page as it stands may keep anybody out, by day or by night.

    What a person would see is kept in the folder that ``BENCH_SCREENSHOTS`` names; nowhere where it names none.
    """
    if folder := os.environ.get("BENCH_SCREENSHOTS"):
        page.screenshot(path=Path(folder) / f"{name}.png", full_page=True)
    for scheme in ("dark", "light"):
        page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
        found = Axe().run(page)
        assert found.violations_count == 0, f"{name}, {scheme}: {found.generate_report()}"


class LiveLink:
    """The live connection of a page, which a test cuts and lets through again; `attach` before the page loads."""

    def __init__(self) -> None:
        self._through = True
        self._sockets: list[WebSocketRoute] = []

    def attach(self, page: Page) -> None:
        page.route_web_socket("**/api/v1/live?*", self._relay)

    def cut(self) -> None:
        self._through = False
        for socket in self._sockets[-1:]:
            socket.close()

    def mend(self) -> None:
        self._through = True

    def _relay(self, socket: WebSocketRoute) -> None:
        if self._through:
            socket.connect_to_server()
            self._sockets.append(socket)
        else:
            socket.close()


@contextmanager
def served(folder: Path, config: str) -> Iterator[str]:
    """Give the address of a service with a configuration; leaving ends it."""
    (folder / "bench.toml").write_text(config, encoding="utf-8")
    with (folder / "log").open("w") as log:
        command = [sys.executable, "-m", "bench_service.cli", "serve", "--port", "0", "--json"]
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=log, text=True)
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line, f"the service did not start: {(folder / 'log').read_text()}"
            yield json.loads(line)["address"]
        finally:
            process.terminate()
            process.wait(timeout=PATIENCE_S)
            assert process.stdout is not None
            process.stdout.close()
