"""A report as PDF, printed by the Chromium that is on the machine: no package of Python is needed for it."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from bench_service.errors import ServiceError

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge")
_LONGEST_S = 120.0
_ANSWER = "install Chromium (Debian: apt install chromium), or take the report as HTML and print it"


class NoPrinterError(ServiceError):
    """Nothing on this machine prints pages, or what does has failed."""

    code = "no_pdf"


def find_browser() -> str | None:
    """Return the program that prints pages, under the first of its usual names."""
    return next((found for name in _NAMES if (found := shutil.which(name)) is not None), None)


def to_pdf(page: bytes) -> bytes:
    """Print a self-contained page, A4.

    Raises
    ------
    NoPrinterError
        There is no Chromium, or it has failed.
    """
    browser = find_browser()
    if browser is None:
        raise NoPrinterError(f"a report as PDF needs Chromium, which is not on this machine: {_ANSWER}", ("format",))
    with tempfile.TemporaryDirectory(prefix="bench-report-") as name:
        folder = Path(name)
        (folder / "report.html").write_bytes(page)
        out = folder / "report.pdf"
        command = [
            browser,
            "--headless",
            "--disable-gpu",
            "--no-first-run",
            "--disable-extensions",
            "--disable-dev-shm-usage",
            "--disable-background-networking",
            f"--user-data-dir={folder / 'profile'}",
            "--no-pdf-header-footer",
            f"--print-to-pdf={out}",
            # As root, as in a container, Chromium has no sandbox; the page is our own, without scripts.
            *(["--no-sandbox"] if os.geteuid() == 0 else []),
            (folder / "report.html").as_uri(),
        ]
        try:
            done = subprocess.run(command, capture_output=True, timeout=_LONGEST_S, check=False)  # noqa: S603
        except subprocess.TimeoutExpired:
            raise NoPrinterError(f"{browser} did not print the report within {_LONGEST_S:g} s: {_ANSWER}") from None
        except OSError as error:
            raise NoPrinterError(f"{browser} cannot be started: {error}; {_ANSWER}") from error
        if done.returncode != 0 or not out.exists():
            last = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["it says nothing"]
            raise NoPrinterError(f"{browser} did not print the report ({last[0][:200]}): {_ANSWER}")
        return out.read_bytes()
