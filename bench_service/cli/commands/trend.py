"""`bench-service trend`: what has become of a cell over a series of runs or cycles."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from bench_service.cli.command import Command
from bench_service.cli.judged_runs import add_judged_runs, read_judged_runs
from bench_service.cli.output import Output
from bench_service.cli.tables import usability_lines

if TYPE_CHECKING:
    from rich.console import Console


def _arguments(parser: ArgumentParser) -> None:
    add_judged_runs(
        parser,
        model_help="of the cell as it was",
        in_order=True,
        soc_help=", as a fraction of what the cell holds then: 1 is full, however aged",
    )
    parser.add_argument("--report", type=Path, metavar="PAGE.html", help="also write a page with the cell's life")


def _run(options: Namespace, output: Output) -> int:
    # Lazy: numba and scipy take 1.3 s.
    from bench_service.cli.trend_page import trend_page
    from bench_service.exchange.atomic import check_writable, write_atomically
    from models.diagnosis.trend.trend import trend

    if options.report is not None:
        check_writable(options.report)
    judged = read_judged_runs(options, output)
    with output.progress("Following the cell") as report, threadpool_limits(1):
        found = trend(
            judged.network,
            judged.runs,
            judged.soc,
            train=judged.train,
            train_soc=judged.train_soc,
            soc_std=judged.soc_std,
            progress=report,
        )
    result = found.to_json() | {"usability": judged.network.record.usability}
    if options.report is not None:
        write_atomically(options.report, trend_page(options.model.name, result))
    output.result(result, lambda console: _show(console, result))
    return 0


def _show(console: Console, result: dict[str, Any]) -> None:
    # Lazy: rich takes 60 ms.
    from rich.table import Table

    from bench_service.cli.trend_page import in_words, where_told

    table = Table("run", "capacity / Ah", "resistance / mOhm", "what is new")
    for each in result["runs"]:
        capacity, sharpest = each["capacity_Ah"], where_told(each)
        ohm = "-"
        if sharpest is not None:
            ohm = f"{1e3 * sharpest['value_Ohm']:.1f} +- {1e3 * sharpest['std_Ohm']:.1f} at SoC {sharpest['soc']:.1f}"
        table.add_row(each["run"], f"{capacity['value']:.3f} +- {capacity['std']:.3f}", ohm, in_words(each))
    console.print(table)
    for line in usability_lines(result["usability"]):
        console.print(line)


COMMAND = Command("trend", "what has become of a cell over a series of runs or cycles", _arguments, _run)
