"""`bench-service fit --module`: the model of a module from its own runs."""

from __future__ import annotations

import time
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.cli.errors import UsageError
from bench_service.cli.files import read_logs, read_model, read_structure, write_document
from bench_service.cli.initial_soc import judged_starts, stated_apart
from bench_service.cli.module_tables import show_module
from bench_service.cli.output import Output
from bench_service.cli.tables import metrics_table, usability_lines

if TYPE_CHECKING:
    from rich.console import Console


def add_module_arguments(parser: ArgumentParser) -> None:
    """Add `--module` and what goes with it."""
    group = parser.add_argument_group(
        "modules",
        "the runs are of cells in series and in parallel; current, voltage and --capacity-Ah are the module's. Columns "
        "v_cell1_V, v_cell2_V ... hold the voltage of each group of parallel cells in series; with them the weak group "
        "is found, and what lies between the cells is told from the cells. MODEL.json then is a module's, which "
        "compare and observe take",
    )
    group.add_argument("--module", action="store_true", help="identify S1 to S4 and take the best")
    group.add_argument(
        "--layout",
        type=_layout,
        metavar="SxP",
        help="cells in series x parallel, such as 6x2 (default: as many as there are columns v_cellN_V, x1)",
    )
    group.add_argument(
        "--cell", type=Path, metavar="CELL.json", help="model of one cell from tests of cells, instead of fitting one"
    )


def check_module_options(options: Namespace) -> None:
    """Refuse what only goes with `--module`; raises UsageError."""
    if not options.module and (options.layout is not None or options.cell is not None):
        raise UsageError("--layout and --cell are of a module: give --module too")


def run_module_fit(options: Namespace, output: Output) -> int:
    """Fit, write and tell."""
    # Lazy: numba and scipy take 1.2 s.
    from bench_service.exchange.atomic import check_writable
    from models.observer.module.tuning import with_tuned_module
    from models.pipeline.module.fit import ModuleFitRequest, fit_module

    check_writable(options.out)
    started = time.perf_counter()
    structure, cell = read_structure(options.structure), None if options.cell is None else read_model(options.cell)
    train = read_logs(options.train, options.current_sign, output)
    validate = read_logs(options.validate, options.current_sign, output)
    runs, judged = [log.run for log in train], [log.run for log in validate]
    soc, judged_soc = stated_apart(runs, judged, options.initial_soc)
    in_series, parallel = options.layout or (None, 1)
    with output.progress("Fitting") as report:
        fitted = fit_module(
            ModuleFitRequest(
                train=train,
                capacity_Ah=options.capacity_Ah,
                in_series=in_series,
                parallel=parallel,
                validate=validate,
                cell=cell,
                initial_soc=soc,
                validate_soc=judged_soc,
                structure=structure,
                without=options.without,
                initial_soc_std=options.initial_soc_std,
                coulombic_efficiency=options.coulombic_efficiency,
                progress=report,
                code_version=version("bench-service"),
            )
        )
        model = with_tuned_module(fitted.model, runs, fitted.initial_soc)
    judged_starts(fitted.validation_runs, output)
    write_document(options.out, model.to_json())
    answer = {"model": str(options.out), **fitted.to_json(), "seconds": round(time.perf_counter() - started, 3)}
    output.result(answer, lambda console: _show(console, answer))
    return 0


def _show(console: Console, answer: dict[str, Any]) -> None:
    module = answer["module"]
    for title, part in (("Training runs, free run", "train"), ("Validation runs, free run", "validation")):
        if answer[part] is not None:
            rows = [(each["run"], each) for each in answer["runs"][part]] + [("all", answer[part])]
            console.print(metrics_table(f"{title}, {module['chosen']}", rows))
    show_module(console, module)
    for line in usability_lines(answer["usability"]):
        console.print(line)
    for text in answer["reservations"]:
        console.print(f"note: {text}")
    console.print(
        f"{module['chosen']} of {module['cells_in_series']} x {module['cells_in_parallel']} cells, "
        f"{answer['structure']} structure, expected on runs it did not see {answer['expected_rmse_mV']:.1f} mV, "
        f"{answer['seconds']:.1f} s; wrote {answer['model']}"
    )


def _layout(text: str) -> tuple[int, int]:
    in_series, cross, parallel = text.partition("x")
    if not (cross and in_series.isdecimal() and parallel.isdecimal() and int(in_series) and int(parallel)):
        raise ArgumentTypeError(f"{text!r} is no layout; write cells in series x parallel, such as 6x2")
    return int(in_series), int(parallel)
