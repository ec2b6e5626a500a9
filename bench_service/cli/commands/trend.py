"""`bench-service trend`: what has become of a cell over a series of runs or cycles."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from bench_service.cli.arguments import fraction, fractions
from bench_service.cli.command import Command
from bench_service.cli.files import add_current_sign, read_model, read_runs
from bench_service.cli.initial_soc import initial_soc
from bench_service.cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("model", type=Path, metavar="MODEL.json", help="of the cell as it was")
    parser.add_argument(
        "runs", type=Path, nargs="+", metavar="RUN", help="CSV, gzipped CSV or Parquet, in time's order"
    )
    parser.add_argument("--train", type=Path, nargs="+", default=[], metavar="RUN", help="runs the model was made from")
    parser.add_argument(
        "--initial-soc",
        type=fractions,
        metavar="S[,S...]",
        help="one value, or one for each RUN, as a fraction of what the cell holds then: 1 is full, however aged",
    )
    parser.add_argument(
        "--train-initial-soc", type=fractions, metavar="S[,S...]", help="the same for the runs of --train"
    )
    parser.add_argument(
        "--initial-soc-std",
        type=fraction,
        metavar="D",
        help="how far off the SoC of the runs' start may be (default: 0.005, a careful statement)",
    )
    parser.add_argument("--report", type=Path, metavar="PAGE.html", help="also write a page with the cell's life")
    add_current_sign(parser)


def _run(options: Namespace, output: Output) -> int:
    # Lazy: numba and scipy take 1.3 s.
    from bench_service.cli.trend_page import trend_page
    from bench_service.exchange.atomic import check_writable, write_atomically
    from models.diagnosis.trend.trend import trend

    if options.report is not None:
        check_writable(options.report)
    network = read_model(options.model)
    runs = read_runs(options.runs, options.current_sign, output)
    train = read_runs(options.train, options.current_sign, output)
    soc = initial_soc(runs, options.initial_soc, network, output)
    train_soc = initial_soc(train, options.train_initial_soc, network, output)
    std = None if options.initial_soc_std is None else [options.initial_soc_std] * len(runs)
    with output.progress("Following the cell") as report, threadpool_limits(1):
        found = trend(
            network, runs, soc, train=train or None, train_soc=train_soc or None, soc_std=std, progress=report
        )
    result = found.to_json()
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


COMMAND = Command("trend", "what has become of a cell over a series of runs or cycles", _arguments, _run)
