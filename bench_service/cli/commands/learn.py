"""`bench-service learn`: a model learns from runs of its cell, one after the other."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich import box
from rich.table import Table
from threadpoolctl import threadpool_limits

from bench_service.cli.arguments import fractions
from bench_service.cli.command import Command
from bench_service.cli.files import add_current_sign, read_model, read_runs, write_document
from bench_service.cli.initial_soc import initial_soc
from bench_service.cli.output import Output
from bench_service.cli.tables import usability_lines

if TYPE_CHECKING:
    from rich.console import Console


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("model", type=Path, metavar="MODEL.json")
    parser.add_argument(
        "runs", type=Path, nargs="+", metavar="RUN", help="CSV, gzipped CSV or Parquet, in time's order"
    )
    parser.add_argument(
        "--validate", type=Path, nargs="+", action="extend", default=[], metavar="RUN", help="runs that only judge"
    )
    parser.add_argument(
        "--initial-soc",
        type=fractions,
        action="extend",
        metavar="S[,S...]",
        help="of RUN..., then of --validate, of what the cell holds then; one value, or one for each; default: soc_ref",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="MODEL2.json", help="the last version")
    add_current_sign(parser)


def _run(options: Namespace, output: Output) -> int:
    # Lazy: numba and scipy take 1.5 s.
    from bench_service.exchange.atomic import check_writable
    from models.comparison.placed_runs import free_run_metrics
    from models.pipeline.learning.learn import learn_from_runs

    check_writable(options.out)
    parent = read_model(options.model)
    runs = read_runs(options.runs, options.current_sign, output)
    validate = read_runs(options.validate, options.current_sign, output)
    soc = initial_soc([*runs, *validate], options.initial_soc, parent, output)
    with output.progress("Learning") as report, threadpool_limits(1):
        found = learn_from_runs(parent, runs, soc[: len(runs)], code_version=version("bench-service"), progress=report)
    versions = [each.to_json() for each in found]
    if validate:
        for each, told in zip(found, versions, strict=True):
            told["validation"] = free_run_metrics(each.network, validate, soc[len(runs) :])
    network = found[-1].network
    write_document(options.out, replace(network, record=replace(network.record, parent=str(options.model))).to_json())
    answer: dict[str, Any] = {
        "model": str(options.out),
        "parent": str(options.model),
        "versions": versions,
        "validation_before": free_run_metrics(parent, validate, soc[len(runs) :]) if validate else None,
        "usability": network.record.usability,
    }
    output.result(answer, lambda console: _show(console, answer))
    return 0


def _show(console: Console, answer: dict[str, Any]) -> None:
    table = Table(title="Each run, before and after it was learned", title_justify="left", box=box.SIMPLE_HEAD)
    judged = answer["validation_before"] is not None
    for label in ("run", "before mV", "after mV", "capacity Ah", *(["validation mV"] if judged else [])):
        table.add_column(label, justify="left" if label == "run" else "right", overflow="fold")
    for each in answer["versions"]:
        value, std = each["capacity_Ah"]["value"], each["capacity_Ah"]["std"]
        cells = [
            f"{each['error_before_mV']:.2f}",
            f"{each['error_after_mV']:.2f}" if each["learned"] else "not learned",
        ]
        cells.append(f"{value:.4f}" + (f" +- {std:.4f}" if std else " (as before)"))
        table.add_row(each["run"], *cells, *([f"{each['validation']['rmse_mV']:.2f}"] if judged else []))
    console.print(table)
    if judged:
        console.print(f"validation runs before: {answer['validation_before']['rmse_mV']:.2f} mV")
    for line in usability_lines(answer["usability"]):
        console.print(line)
    console.print(f"wrote {answer['model']}")


COMMAND = Command("learn", "let a model learn from runs of its cell, version by version", _arguments, _run)
