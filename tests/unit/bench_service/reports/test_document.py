"""The one template: every kind of part, nothing unescaped, nothing fetched, a style that its own headers allow."""

import base64
import hashlib
import re

from bench_service.reports.document import (
    Heading,
    Key,
    Keys,
    Points,
    Report,
    Section,
    Table,
    render,
    security_headers,
)
from bench_service.reports.drawing import Bar, bars

EVIL = "<script>alert('x')</script>"


def page() -> str:
    parts = [
        EVIL,
        Points([EVIL]),
        Keys([Key(EVIL, EVIL, EVIL)]),
        Table([EVIL], [[EVIL]]),
        bars(EVIL, [Bar(EVIL, 1.0, EVIL)]),
    ]
    heading = Heading("Run", EVIL, cell=EVIL, bench="sim", more=[(EVIL, EVIL)], made=EVIL)
    return render(Report(heading, parts, [Section(EVIL, parts)])).decode()


def test_nothing_that_somebody_wrote_becomes_a_part_of_the_page() -> None:
    text = page()
    assert "<script" not in text and text.count("&lt;script&gt;") > 15
    assert not re.search(r'(?:src|href|url)\s*[=(]|style="|http', text)


def test_what_nobody_has_said_is_called_so() -> None:
    rows = dict(Heading("Run", "t", bench="sim").rows)
    assert rows == {
        "Cell": "not told",
        "Bench": "sim",
        "Operator": "not told",
        "Measured": "not told",
        "Model": "not told",
    }


def test_a_browser_takes_the_style_and_nothing_else() -> None:
    found = re.search(r"<style>(.*?)</style>", page(), re.DOTALL)
    assert found is not None
    digest = base64.b64encode(hashlib.sha256(found[1].encode()).digest()).decode()
    policy = security_headers()["Content-Security-Policy"]
    assert f"style-src 'sha256-{digest}'" in policy and "default-src 'none'" in policy


def test_a_page_is_printed_on_paper_without_cutting_its_charts() -> None:
    text = page()
    assert "size: A4" in text and "break-inside: avoid" in text
