"""`bench-service diagnose`: which effect is missing in a model, or new in its cell, with evidence."""

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
    parser.add_argument("model", type=Path, metavar="MODEL.json")
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN", help="CSV, gzipped CSV or Parquet")
    parser.add_argument("--train", type=Path, nargs="+", default=[], metavar="RUN", help="runs the model was made from")
    parser.add_argument(
        "--mode",
        choices=["structure", "change"],
        default="structure",
        help="structure: what does the model lack? change: the model was right, what is new?",
    )
    parser.add_argument("--initial-soc", type=fractions, metavar="S[,S...]", help="one value, or one for each RUN")
    parser.add_argument(
        "--train-initial-soc", type=fractions, metavar="S[,S...]", help="the same for the runs of --train"
    )
    parser.add_argument(
        "--initial-soc-std",
        type=fraction,
        metavar="D",
        help="change: how far off the SoC of the runs' start may be (default: 0.005, a careful statement)",
    )
    parser.add_argument("--report", type=Path, metavar="PAGE.html", help="also write a page with the evidence")
    add_current_sign(parser)


def _run(options: Namespace, output: Output) -> int:

    # Lazy: numba and scipy take 1.3 s.
    from bench_service.cli.diagnosis_page import diagnosis_page
    from bench_service.exchange.atomic import check_writable, write_atomically
    from models.diagnosis import diagnose

    if options.report is not None:
        check_writable(options.report)
    network = read_model(options.model)
    runs = read_runs(options.runs, options.current_sign, output)
    train = read_runs(options.train, options.current_sign, output)
    soc = initial_soc(runs, options.initial_soc, network, output)
    train_soc = initial_soc(train, options.train_initial_soc, network, output)
    std = None if options.initial_soc_std is None else [options.initial_soc_std] * len(runs)
    with output.progress("Diagnosing"), threadpool_limits(1):
        diagnosis = diagnose(
            network, runs, soc, train=train or None, train_soc=train_soc or None, mode=options.mode, soc_std=std
        )
    result = diagnosis.to_json()
    if options.report is not None:
        write_atomically(options.report, diagnosis_page(options.model.name, network, runs, soc, result))
    output.result(result, lambda console: _show(console, result))
    return 0


def _show(console: Console, result: dict[str, Any]) -> None:
    # Lazy: numba and scipy take 1.2 s.
    from bench_service.cli.diagnosis_page import VERDICTS, left_over

    console.print(f"[bold]{VERDICTS[result['verdict']]}[/bold]")
    for finding in result["findings"]:
        console.print(
            f"\n{finding['rank']}. [bold]{finding['effect']}[/bold]  confidence {100 * finding['confidence']:.0f} %  "
            f"error {finding['error_before_mV']:.1f} -> {finding['error_after_mV']:.1f} mV "
            f"({100 * finding['explained_share']:.0f} % of the squared error)"
        )
        console.print(finding["explanation"])
    for each in result["depends_on"]:
        console.print(f"the error depends on {each['variable']}: {100 * each['strength']:.0f} % of it")
    console.print(f"\n{left_over(result)}")
    if result["next_experiment"] is not None:
        rivals = " from ".join(result["next_experiment"]["rivals"])
        console.print(f"next experiment: a profile that tells {rivals} (the request is in the --json answer)")
    for remark in result["remarks"]:
        console.print(f"note: {remark}")


COMMAND = Command("diagnose", "which effect is missing in a model, or new in its cell", _arguments, _run)
