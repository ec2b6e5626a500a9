"""`bench-service add-effect`: put an effect into a model, refit it, and see what it is worth on held-out runs."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from bench_service.cli.arguments import fractions
from bench_service.cli.command import Command
from bench_service.cli.files import add_runs_to_learn_from, read_model, read_runs, write_document
from bench_service.cli.initial_soc import starts_apart
from bench_service.cli.output import Output
from bench_service.cli.tables import usability_lines

if TYPE_CHECKING:
    from rich.console import Console

    from models.pipeline.addition import Addition


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("model", type=Path, metavar="MODEL.json")
    parser.add_argument("effect", metavar="EFFECT", help="name of an effect, as `diagnose` gives it")
    parser.add_argument(
        "--train", type=Path, nargs="+", action="extend", required=True, metavar="RUN", help="runs to refit to"
    )
    parser.add_argument(
        "--validate", type=Path, nargs="+", action="extend", required=True, metavar="RUN", help="runs that only judge"
    )
    add_runs_to_learn_from(parser, "MODEL2.json")
    parser.add_argument(
        "--train-initial-soc",
        type=fractions,
        action="extend",
        metavar="S[,S...]",
        help="of the training runs alone; --initial-soc is then that of the validation runs",
    )


def _run(options: Namespace, output: Output) -> int:

    # Lazy: numba and scipy take 1.3 s.
    from bench_service.exchange.atomic import check_writable
    from models.effects import effect
    from models.observer.tuning.tuning import with_tuned_observer
    from models.pipeline.addition import add_effect

    effect(options.effect)  # a name that there is not is told before anything is read
    check_writable(options.out)
    network = read_model(options.model)
    train = read_runs(options.train, options.current_sign, output)
    validate = read_runs(options.validate, options.current_sign, output)
    train_soc, soc = starts_apart(train, validate, options, network, output)
    with output.progress("Adding") as report, threadpool_limits(1):
        added = add_effect(network, options.effect, train, train_soc, validate, soc, progress=report)
        network = with_tuned_observer(added.network, train, train_soc)
    record = replace(network.record, parent=str(options.model))
    write_document(options.out, replace(network, record=record).to_json())
    answer = _answer(added, options.out, options.model)
    output.result(answer, lambda console: _show(console, answer))
    return 0


def _answer(added: Addition, out: Path, parent: Path) -> dict[str, Any]:
    return {
        "effect": added.effect,
        "model": str(out),
        "parent": str(parent),
        "error_before_mV": added.before.overall_mV,
        "error_after_mV": added.after.overall_mV,
        "parameters": {
            name: {"value": each.value, "std": each.std, "unit": each.unit} for name, each in added.parameters.items()
        },
        "remark": added.remark,
        "usability": added.network.record.usability,
    }


def _show(console: Console, answer: dict[str, Any]) -> None:
    console.print(
        f"[bold]{answer['effect']}[/bold]: held-out error {answer['error_before_mV']:.2f} -> "
        f"{answer['error_after_mV']:.2f} mV"
    )
    for name, each in answer["parameters"].items():
        band = "" if each["std"] is None else f" +- {each['std']:.2g}"
        console.print(f"  {name} = {each['value']:.4g}{band} {each['unit']}")
    console.print(answer["remark"])
    for line in usability_lines(answer["usability"]):
        console.print(line)
    console.print(f"wrote {answer['model']}; its parent is {answer['parent']}")


COMMAND = Command("add-effect", "put an effect into a model and refit it", _arguments, _run)
