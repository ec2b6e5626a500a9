"""What a report is made of, and the one page that all of them become."""

from __future__ import annotations

import hashlib
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup

_HERE = Path(__file__).parent
_UNTOLD = "not told"


@dataclass(frozen=True, slots=True)
class Heading:
    """Whose report it is; None: nobody has said.

    Attributes
    ----------
    kind : "Run", "Comparison", ...
    title : str
    cell, bench, operator, dates, model : str or None
    more : pairs of name and text
        What else a reader must know to find everything again.
    made : str
        When and by which program the report was made.
    """

    kind: str
    title: str
    cell: str | None = None
    bench: str | None = None
    operator: str | None = None
    dates: str | None = None
    model: str | None = None
    more: Sequence[tuple[str, str]] = ()
    made: str = ""

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Names and texts, in the order of every report."""
        told = (
            ("Cell", self.cell),
            ("Bench", self.bench),
            ("Operator", self.operator),
            ("Measured", self.dates),
            ("Model", self.model),
        )
        return [*((name, text or _UNTOLD) for name, text in told), *self.more]


@dataclass(frozen=True, slots=True)
class Points:
    """A list of sentences."""

    items: Sequence[str]
    shape: str = "points"


@dataclass(frozen=True, slots=True)
class Key:
    """A figure that a reader looks for first, with what it is to be held against."""

    name: str
    value: str
    note: str = ""


@dataclass(frozen=True, slots=True)
class Keys:
    """The figures that a reader looks for first."""

    items: Sequence[Key]
    shape: str = "keys"


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of texts; columns of `numbers` stand right."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    numbers: frozenset[int] = frozenset()
    shape: str = "table"


@dataclass(frozen=True, slots=True)
class Legend:
    """What a colour of a chart stands for; a dashed line, or a filled mark."""

    label: str
    colour: str
    dashed: bool = False
    filled: bool = False


@dataclass(frozen=True, slots=True)
class Figure:
    """A chart as SVG, what it shows, and what its colours stand for."""

    caption: str
    svg: Markup
    legend: Sequence[Legend] = ()
    shape: str = "figure"


Part = str | Points | Keys | Table | Figure


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a report under a title of its own."""

    title: str
    parts: Sequence[Part]


@dataclass(frozen=True, slots=True)
class Report:
    """A report: who and what, the answer in short, then the evidence."""

    heading: Heading
    summary: Sequence[Part] = ()
    sections: Sequence[Section] = field(default_factory=tuple)


def render(report: Report) -> bytes:
    """Return one self-contained page as UTF-8: nothing is fetched, nothing runs."""
    text = _environment().get_template("template.html").render(report=report, style=Markup(_style()))
    return text.encode()


@cache
def security_headers() -> dict[str, str]:
    """Headers under which a browser shows a report: its own style, and nothing else."""
    digest = b64encode(hashlib.sha256(_style().encode()).digest()).decode()
    policy = f"default-src 'none'; style-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    return {
        "Content-Security-Policy": f"{policy}; frame-ancestors 'none'",
        "X-Content-Type-Options": "nosniff",
        "Cache-Control": "no-store",
    }


@cache
def _style() -> str:
    return (_HERE / "style.css").read_text(encoding="utf-8")


@cache
def _environment() -> Environment:
    return Environment(
        loader=FileSystemLoader(_HERE), autoescape=True, trim_blocks=True, lstrip_blocks=True, auto_reload=False
    )
