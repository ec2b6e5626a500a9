"""`bench-service trend`: what has become of a cell over a series of runs or cycles."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING, Any

from bench_service.cli.arguments import fraction, numbers
from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.judged_runs import add_judged_runs, read_judged_runs
from bench_service.cli.output import Output
from bench_service.cli.report_options import add_report, check_report, heading_of, runs_text, write_report
from bench_service.cli.tables import usability_lines

if TYPE_CHECKING:
    from rich.console import Console

    from models.diagnosis.trend.life import Places


def _arguments(parser: ArgumentParser) -> None:
    add_judged_runs(
        parser,
        model_help="of the cell as it was",
        in_order=True,
        soc_help=", as a fraction of what the cell holds then: 1 is full, however aged",
    )
    parser.add_argument(
        "--at",
        type=numbers,
        metavar="X[,X...]",
        help="place of each RUN along the life, such as its cycle (default: the runs are counted)",
    )
    parser.add_argument("--unit", metavar="NAME", help="of --at (default: cycle)")
    parser.add_argument(
        "--end", type=fraction, default=0.8, metavar="S", help="share of the capacity that is the end (default: 0.8)"
    )
    add_report(parser, "the cell's life")


def _run(options: Namespace, output: Output) -> int:
    # Lazy: numba and scipy take 1.3 s.
    from bench_service.jobs.beside import spread
    from models.diagnosis.trend.trend import trend

    check_report(options)
    if options.at is not None and len(options.at) != len(options.runs):
        raise UsageError(f"--at names {len(options.at)} place(s) for {len(options.runs)} run(s)")
    judged = read_judged_runs(options, output)
    with output.progress("Following the cell") as report:
        found = trend(
            judged.network,
            judged.runs,
            judged.soc,
            train=judged.train,
            train_soc=judged.train_soc,
            soc_std=judged.soc_std,
            places=_places(options),
            progress=report,
            spread=spread,
        )
    result = found.to_json() | {"usability": judged.network.record.usability}
    if options.report is not None:
        from bench_service.reports.life import life_report

        heading = heading_of(options, "Life", f"Life of a cell in {runs_text(judged.runs)}", judged.runs)
        result["report"] = write_report(options.report, life_report(heading, result))
    output.result(result, lambda console: _show(console, result))
    return 0


def _places(options: Namespace) -> Places:
    # Lazy: numba and scipy take 1.3 s.
    from models.diagnosis.trend.life import Places

    at = None if options.at is None else list(options.at)
    return Places(at, options.unit or ("run" if at is None else "cycle"), options.end)


def _show(console: Console, result: dict[str, Any]) -> None:
    # Lazy: rich takes 60 ms.
    from rich.table import Table

    from bench_service.reports.life import in_words, to_settle, where_told

    table = Table("run", "capacity / Ah", "resistance / mOhm", "what is new")
    for each in result["runs"]:
        capacity, sharpest = each["capacity_Ah"], where_told(each)
        ohm = "-"
        if sharpest is not None:
            ohm = f"{1e3 * sharpest['value_Ohm']:.1f} +- {1e3 * sharpest['std_Ohm']:.1f} at SoC {sharpest['soc']:.1f}"
        table.add_row(each["run"], f"{capacity['value']:.3f} +- {capacity['std']:.3f}", ohm, in_words(each))
    console.print(table)
    for each in result["change_points"]:
        first, last = each["between"]
        console.print(f"{each['effect']} since {each['run']} (between {first} and {last})")
    if result["forecast"] is not None:
        console.print(result["forecast"]["explanation"])
    if (said := to_settle(result)) is not None:
        console.print(f"{said} (The request is in the --json answer.)")
    for line in usability_lines(result["usability"]):
        console.print(line)


COMMAND = Command("trend", "what has become of a cell over a series of runs or cycles", _arguments, _run)
