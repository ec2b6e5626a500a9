"""Reports on paper: printed by Chromium where there is one, else one line says what to install."""

import re

import pytest

from bench_service.reports import pdf
from bench_service.reports.document import Heading, Report, render
from bench_service.reports.pdf import NoPrinterError, find_browser, to_pdf

PAGE = render(Report(Heading("Run", "on paper")))


@pytest.mark.skipif(find_browser() is None, reason="no Chromium on this machine")
def test_a_page_is_printed_on_a4() -> None:
    made = to_pdf(PAGE)
    assert made.startswith(b"%PDF-")
    size = re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", made)
    assert size is not None
    assert (float(size[1]), float(size[2])) == pytest.approx((595.0, 842.0), abs=1.5)


def test_without_a_browser_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pdf.shutil, "which", lambda _: None)
    with pytest.raises(NoPrinterError, match="apt install chromium"):
        to_pdf(PAGE)


def test_a_browser_that_fails_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pdf, "find_browser", lambda: "/bin/false")
    with pytest.raises(NoPrinterError, match="/bin/false did not print"):
        to_pdf(PAGE)
