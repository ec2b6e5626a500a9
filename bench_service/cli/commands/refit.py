"""`bench-service refit`: a model's parameters from new runs, with what it still knows of its old ones."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from bench_service.cli.arguments import fraction
from bench_service.cli.command import Command
from bench_service.cli.files import add_runs_to_learn_from, read_model, read_runs, write_document
from bench_service.cli.initial_soc import initial_soc
from bench_service.cli.output import Output
from bench_service.cli.tables import metrics_table, usability_lines

if TYPE_CHECKING:
    from rich.console import Console

    from models.network.local_model_network import LocalModelNetwork


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("model", type=Path, metavar="MODEL.json")
    parser.add_argument("train", type=Path, nargs="+", metavar="RUN", help="new runs of the cell")
    parser.add_argument(
        "--validate", type=Path, nargs="+", action="extend", default=[], metavar="RUN", help="runs that only judge"
    )
    parser.add_argument(
        "--old-weight",
        type=fraction,
        metavar="W",
        help="how much a sample of the old runs counts beside a new one; default: chosen on parts of the new runs",
    )
    add_runs_to_learn_from(parser, "MODEL2.json")


def _run(options: Namespace, output: Output) -> int:

    # Lazy: numba and scipy take 1.5 s.
    from bench_service.exchange.atomic import check_writable
    from bench_service.jobs.refitting import refitted
    from models.comparison.placed_runs import free_run_metrics

    check_writable(options.out)
    parent = read_model(options.model)
    train = read_runs(options.train, options.current_sign, output)
    validate = read_runs(options.validate, options.current_sign, output)
    soc = initial_soc([*train, *validate], options.initial_soc, parent, output)
    learned, judged = soc[: len(train)], soc[len(train) :]
    if not _weighs(parent):
        output.warn(f"{options.model} holds no sums of its runs: what they said is not weighed against the new ones")
    with output.progress("Refitting"), threadpool_limits(1):
        network = refitted(parent, train, learned, options.old_weight)
    record = replace(network.record, parent=str(options.model))
    write_document(options.out, replace(network, record=record).to_json())
    answer = {"model": str(options.out), "parent": str(options.model), **_figures(parent, network)}
    answer["validation"] = None
    if validate:
        before, after = (free_run_metrics(each, validate, judged) for each in (parent, network))
        answer["validation"] = {"before": before, "after": after}
    output.result(answer, lambda console: _show(console, answer))
    return 0


def _weighs(parent: LocalModelNetwork) -> bool:
    """Whether a model holds what its old runs said: as sums or, a bounded one, as a covariance."""
    from models.pipeline.refitting import remembers  # lazy: numba and scipy take 1.5 s

    return parent.record.sums is not None or remembers(parent)


def _figures(parent: LocalModelNetwork, network: LocalModelNetwork) -> dict[str, Any]:
    """What the refit itself says of the new runs."""
    from models.network.lineage import version_of  # lazy: numpy takes 90 ms

    made = version_of(network)
    assert made is not None  # every refit says how it was made
    return {
        "old_weight": made.settings["old_weight"] if _weighs(parent) else None,
        "train": {"before": made.errors["parent"], "after": made.errors["train"]},
        "usability": network.record.usability,
        "reservations": list(network.record.reservations),
    }


def _show(console: Console, answer: dict[str, Any]) -> None:

    for title, part in (("New runs, free run", "train"), ("Validation runs, free run", "validation")):
        if answer[part] is not None:
            console.print(metrics_table(title, [(when, answer[part][when]) for when in ("before", "after")]))
    if answer["old_weight"] is not None:
        console.print(f"a sample of the old runs counts {answer['old_weight']:g} of a new one")
    for line in usability_lines(answer["usability"]):
        console.print(line)
    for text in answer["reservations"]:
        console.print(f"note: {text}")
    console.print(f"wrote {answer['model']}; its parent is {answer['parent']}")


COMMAND = Command("refit", "fit a model's parameters again with new runs", _arguments, _run)
