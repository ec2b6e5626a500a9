"""Reports that commands write: the options that ask for one, and what its heading says of files."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from bench_service.cli.errors import UsageError

if TYPE_CHECKING:
    from bench_service.reports.document import Heading, Report
    from models.data.timeseries import TimeSeries

_PDF = ".pdf"
_MOST_RUNS = 6


def add_report(parser: ArgumentParser, what: str) -> None:
    """Add `--report`, and who and what its heading names; `what` is in it."""
    parser.add_argument(
        "--report", type=Path, metavar="FILE.html|.pdf", help=f"also write a report: {what}; PDF needs Chromium"
    )
    for name, about in (("cell", "whose data these are"), ("bench", "that measured"), ("operator", "who measured")):
        parser.add_argument(f"--{name}", metavar="NAME", help=f"{about}, for the heading of the report")


def check_report(options: Namespace) -> None:
    """Refuse a report that could not be written, before the work begins.

    Raises
    ------
    UsageError
        It is to be PDF, and nothing on this machine prints.
    """
    if options.report is None:
        return
    # Lazy: a command without a report pays for none.
    from bench_service.exchange.atomic import check_writable
    from bench_service.reports.pdf import find_browser

    check_writable(options.report)
    if kind_of(options.report) == "pdf" and find_browser() is None:
        raise UsageError(
            f"--report {options.report}: PDF needs Chromium, which is not on this machine: install it "
            "(Debian: apt install chromium), or name a file that ends in .html"
        )


def kind_of(path: Path) -> str:
    """Whether a report is to be PDF or HTML."""
    return "pdf" if path.suffix.lower() == _PDF else "html"


def write_report(path: Path, report: Report) -> str:
    """Write a report, as PDF where the file's name says so; give the file's name."""
    # Lazy: jinja2 takes 40 ms.
    from bench_service.exchange.atomic import write_atomically
    from bench_service.reports.document import render
    from bench_service.reports.pdf import to_pdf

    page = render(report)
    write_atomically(path, to_pdf(page) if kind_of(path) == "pdf" else page)
    return str(path)


def heading_of(options: Namespace, kind: str, title: str, runs: Sequence[TimeSeries]) -> Heading:
    """Heading of a report on files: their names, and what the options tell."""
    # Lazy: jinja2 takes 40 ms.
    from bench_service.reports.document import Heading
    from bench_service.reports.words import listed, made_by

    names = [run.name for run in runs[:_MOST_RUNS]]
    rest = [f"{len(runs) - _MOST_RUNS} more"] if len(runs) > _MOST_RUNS else []
    about = ("Run" if len(runs) == 1 else "Runs", listed([*names, *rest]))
    model, made = options.model.name, made_by(version("bench-service"))
    return Heading(kind, title, options.cell, options.bench, options.operator, None, model, [about], made)


def design_heading(options: Namespace, name: str, model: str | None) -> Heading:
    """Heading of the report of a design."""
    # Lazy: jinja2 takes 40 ms.
    from bench_service.reports.document import Heading
    from bench_service.reports.words import made_by

    dates, made = "a plan, not played yet", made_by(version("bench-service"))
    who = (options.cell, options.bench, options.operator)
    return Heading("Design", name, *who, dates, model or "none yet", made=made)


def runs_text(runs: Sequence[TimeSeries]) -> str:
    """Name one run, or count several."""
    return f"run {runs[0].name}" if len(runs) == 1 else f"{len(runs)} runs"
