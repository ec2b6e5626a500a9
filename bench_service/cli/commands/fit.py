"""`bench-service fit`: identify a local model network from measured runs."""

from __future__ import annotations

import time
from argparse import ArgumentParser, Namespace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.cli.arguments import efficiency, fraction, names, positive
from bench_service.cli.command import Command
from bench_service.cli.files import add_runs_to_learn_from, read_runs, read_structure, write_document
from bench_service.cli.initial_soc import judged_starts, stated_apart
from bench_service.cli.module_fit import add_module_arguments, check_module_options, run_module_fit
from bench_service.cli.output import Output
from bench_service.cli.tables import metrics_table, readout_lines, rivals_line, soc_text, terms_line, usability_lines

if TYPE_CHECKING:
    from rich.console import Console

    from models.network.local_model_network import LocalModelNetwork
    from models.pipeline.fit import FitResult


_NARROW_SOC = 0.1


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("train", type=Path, nargs="+", metavar="TRAIN", help="CSV, gzipped CSV or Parquet")
    parser.add_argument(
        "--validate", type=Path, nargs="+", action="extend", default=[], metavar="RUN", help="runs the fit never sees"
    )
    parser.add_argument("--capacity-Ah", type=positive, required=True, metavar="Q")
    parser.add_argument(
        "--structure",
        default="auto",
        metavar="auto|full|minimal|bounded|searched|FILE.json",
        help="bounded: physical by construction, without output feedback; auto (default): it or a better one",
    )
    parser.add_argument(
        "--without",
        type=names,
        action="extend",
        default=[],
        metavar="EFFECT[,EFFECT...]",
        help="leave effects out of the bounded network, such as hysteresis",
    )
    add_runs_to_learn_from(parser, "MODEL.json")
    _charge_arguments(parser)
    add_module_arguments(parser)


def _charge_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--initial-soc-std",
        type=fraction,
        default=0.0,
        metavar="D",
        help="how far off the SoC of a training run's start may be; it is then estimated with the fit (default: known)",
    )
    parser.add_argument(
        "--coulombic-efficiency",
        type=efficiency,
        default=1.0,
        metavar="E",
        help="share of the charge going in that comes out again (default: 1)",
    )


def _run(options: Namespace, output: Output) -> int:
    check_module_options(options)
    if options.module:
        return run_module_fit(options, output)
    # Lazy: numba and scipy take 1.2 s.
    from bench_service.exchange.atomic import check_writable
    from models.observer.tuning.tuning import with_tuned_observer
    from models.pipeline.fit import fit_network

    check_writable(options.out)
    structure = read_structure(options.structure)
    started = time.perf_counter()
    train = read_runs(options.train, options.current_sign, output)
    validate = read_runs(options.validate, options.current_sign, output)
    soc, judged_soc = stated_apart(train, validate, options.initial_soc)
    with output.progress("Fitting") as report:
        fitted = fit_network(
            train,
            capacity_Ah=options.capacity_Ah,
            structure=structure,
            without=tuple(options.without),
            validate=validate,
            initial_soc=soc,
            validate_soc=judged_soc,
            initial_soc_std=options.initial_soc_std,
            coulombic_efficiency=options.coulombic_efficiency,
            progress=report,
            code_version=version("bench-service"),
        )
    judged_soc = judged_starts(fitted.validation_runs, output)
    held_out = (validate, judged_soc) if validate else None
    network = with_tuned_observer(fitted.network, train, fitted.initial_soc, held_out)
    write_document(options.out, network.to_json())
    _warn_of_narrow_soc(fitted.network, output)
    answer = _answer(fitted, options.out, time.perf_counter() - started)
    output.result(answer, lambda console: _show(console, answer))
    return 0


def _warn_of_narrow_soc(network: LocalModelNetwork, output: Output) -> None:
    low, high = network.record.domain["soc"]
    if high - low < _NARROW_SOC:
        output.warn(
            f"the training runs cover the state of charge from {low:.3f} to {high:.3f} only: elsewhere the model "
            "extrapolates; record runs over the range that it is for"
        )


def _answer(fitted: FitResult, out: Path, seconds: float) -> dict[str, Any]:
    from models.readouts.tables import summary  # lazy: numba and scipy take 1.2 s

    return {
        "model": str(out),
        "structure": fitted.network.structure.name,
        "n_samples": fitted.n_samples,
        "n_local_models": fitted.network.n_models,
        "seconds": round(seconds, 3),
        "train": fitted.train,
        "validation": fitted.validation,
        "expected_rmse_mV": fitted.expected_rmse_mV,
        "compared": fitted.compared,
        "terms": fitted.terms,
        "usability": fitted.network.record.usability,
        "runs": {"train": fitted.train_runs, "validation": fitted.validation_runs},
        "readouts": summary(fitted.network),
        "reservations": list(fitted.network.record.reservations),
    }


def _show(console: Console, answer: dict[str, Any]) -> None:
    for title, part in (("Training runs, free run", "train"), ("Validation runs, free run", "validation")):
        if answer[part] is not None:
            rows = [(each["run"], each) for each in answer["runs"][part]] + [("all", answer[part])]
            if part == "train":
                rows.append(("expected on runs it did not see", {"rmse_mV": answer["expected_rmse_mV"]}))
            console.print(metrics_table(title, rows))
    for each in answer["runs"]["train"]:
        if each["initial_soc"]["std"] is not None:
            console.print(f"{each['run']}: SoC at its start {soc_text(each['initial_soc'])}")
    for line in (*rivals_line(answer), *terms_line(answer["terms"]), *readout_lines(answer["readouts"])):
        console.print(line)
    for line in usability_lines(answer["usability"]):
        console.print(line)
    for text in answer["reservations"]:
        console.print(f"note: {text}")
    console.print(
        f"{answer['structure']} structure, {answer['n_local_models']} local models, {answer['n_samples']} training "
        f"samples, {answer['seconds']:.1f} s; wrote {answer['model']}"
    )


COMMAND = Command("fit", "identify a local model network from measured runs", _arguments, _run)
