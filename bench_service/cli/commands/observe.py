"""`bench-service observe`: replay measured runs through the fuzzy observer."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich import box
from rich.table import Table

from bench_service.cli.arguments import fractions, named_numbers
from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.files import add_current_sign, read_any_model, read_module, read_runs
from bench_service.cli.initial_soc import guessed_soc
from bench_service.cli.output import Output
from bench_service.cli.report_options import add_report, check_report, heading_of, write_report
from bench_service.cli.tables import usability_lines

if TYPE_CHECKING:
    from rich.console import Console

    from models.data.timeseries import TimeSeries
    from models.module.network import ModuleNetwork
    from models.network.local_model_network import LocalModelNetwork
    from models.observer import FuzzyObserver
    from models.observer.module.module_observer import ModuleObserver
    from models.observer.observation import Observation

_FIGURES = (
    ("soc_rmse", "SoC RMSE %", 100.0),
    ("soc_max_error", "max %", 100.0),
    ("soc_end_error", "end %", 100.0),
    ("converged_after_s", "converged s", 1.0),
    ("coverage_95", "in 95 % band %", 100.0),
)


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("model", type=Path, metavar="MODEL.json", help="of a cell, or of a module (fit --module)")
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN", help="CSV, gzipped CSV or Parquet")
    parser.add_argument(
        "--initial-soc",
        type=fractions,
        action="extend",
        metavar="S[,S...]",
        help="where the observer starts; default: soc_ref, else 0.5",
    )
    parser.add_argument("--module", type=Path, metavar="MODULE.json", help="the runs are of a module (S1 to S4)")
    parser.add_argument(
        "--cell-spread",
        type=named_numbers,
        metavar="NAME=S[,...]",
        help="standard deviation among the module's cells of soc (0.01), capacity (0.02), resistance (0.05), and of "
        "connectors beside them (0.15), as fractions",
    )
    parser.add_argument(
        "--gain",
        choices=("kalman", "steady"),
        help="kalman: from the covariance of the moment; steady: the local models' gains from the discrete Riccati "
        "equation, blended; default: as the model has it, which is kalman where nobody has chosen",
    )
    add_report(parser, "estimates, convergence")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="SOC.csv",
        help="also write the estimates, and the state of charge with all of a run known",
    )
    add_current_sign(parser)


def _run(options: Namespace, output: Output) -> int:
    # Lazy: numba and scipy take 1.2 s.
    from bench_service.exchange.atomic import check_writable
    from models.module.network import cell_network
    from models.observer.module.module_observer import ModuleObserver
    from models.observer.observation import answer_of, observe

    check_report(options)
    if options.out is not None:
        check_writable(options.out)
    model = read_any_model(options.model)
    network, observer = cell_network(model), _observer(options, model)
    cell = observer.cell if isinstance(observer, ModuleObserver) else observer
    runs = read_runs(options.runs, options.current_sign, output)
    as_cells = [observer.mean_cell_run(run) for run in runs] if isinstance(observer, ModuleObserver) else runs
    starts = guessed_soc(as_cells, options.initial_soc, network, output)
    observed: list[Observation] = []
    with output.progress("Observing") as report:
        for done, (run, (soc, soc_std)) in enumerate(zip(runs, starts, strict=True)):
            report(done / len(runs), run.name)
            observed.append(observe(observer, run, soc, soc_std))
    answer = answer_of(observer, observed)
    if options.out is not None:
        _write(options.out, observed)
        answer["file"] = str(options.out)
    if options.report is not None:
        answer["report"] = _report(options, cell, as_cells, observed)
    output.result(answer, lambda console: _show(console, answer, observed))
    return 0


def _observer(options: Namespace, model: LocalModelNetwork | ModuleNetwork) -> FuzzyObserver | ModuleObserver:
    """Observer of a cell, or of a module: by the model's own module model, or by that of `--module`."""
    # Lazy: numba and scipy take 1.2 s.
    from models.module.network import ModuleNetwork
    from models.observer.module.module_errors import CellSpread
    from models.observer.module.module_observer import ModuleObserver
    from models.observer.module.tuning import module_observer
    from models.observer.observation import observer_of

    declared = None if options.cell_spread is None else CellSpread.declared(options.cell_spread)
    if isinstance(model, ModuleNetwork):
        if options.module is not None:
            raise UsageError(f"{options.model}: is the model of a module already: leave --module out")
        return module_observer(model, options.gain, declared)
    cell = observer_of(model, options.gain)
    if options.module is not None:
        return ModuleObserver(cell, read_module(options.module), declared or CellSpread())
    if declared is not None:
        raise UsageError("--cell-spread is of the cells of a module: give --module MODULE.json too")
    return cell


def _report(options: Namespace, cell: FuzzyObserver, runs: Sequence[TimeSeries], observed: list[Observation]) -> str:
    # Lazy: numba and scipy take 1.2 s.
    from bench_service.reports.observer import observer_report
    from models.data.errors import ModelError
    from models.data.resampling import to_grid
    from models.effects.input_correction import as_read
    from models.observer.tuning.trade_off import trade_off

    grid = [to_grid(as_read(cell.network.record, run), cell.dt_s) for run in runs]
    try:
        choices = trade_off(cell, grid)
    except ModelError:
        choices = []
    heading = heading_of(options, "Observer", f"State of charge with {options.model.stem}", runs)
    return write_report(options.report, observer_report(heading, cell, observed, choices))


def _write(path: Path, observed: Sequence[Observation]) -> None:
    # Lazy: numpy takes 80 ms.
    import numpy as np

    from bench_service.exchange.write import write_results

    columns: dict[str, Any] = {"run": np.concatenate([np.full(len(each.time_s), each.name) for each in observed])}
    for name in ("time_s", "soc", "soc_std", "model_voltage_V", "innovation_V"):
        columns[name] = np.concatenate([getattr(each, name) for each in observed])
    for name in ("soc", "soc_std"):
        columns[f"smoothed_{name}"] = np.concatenate([getattr(each.smoothed, name) for each in observed])
    write_results(path, columns)


def _show(console: Console, answer: dict[str, Any], observed: Sequence[Observation]) -> None:
    judged = any(each["soc_rmse"] is not None for each in answer["runs"])
    table = Table(title="State of charge", title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("run", overflow="fold")
    for label in ("at first %", "at last %", "+- %", *(label for _, label, _ in _FIGURES if judged)):
        table.add_column(label, justify="right")
    for each, estimates in zip(answer["runs"], observed, strict=True):
        ends = (estimates.soc[0], estimates.soc[-1], estimates.soc_std[-1])
        against = ["-" if each[key] is None else f"{scale * each[key]:.2f}" for key, _, scale in _FIGURES if judged]
        table.add_row(each["run"], *(f"{100.0 * value:.2f}" for value in ends), *against)
    console.print(table)
    if not judged:
        console.print("errors are told of runs that have a reference: a column soc_ref, as a fraction")
    for each in answer["runs"]:
        after, start = each["smoothed"], each["smoothed"]["initial_soc"]
        error = "" if after["soc_rmse"] is None else f", RMSE {100 * after['soc_rmse']:.2f} %"
        began = f"it began at {100 * start['value']:.1f} +- {100 * start['std']:.1f} %"
        console.print(f"{each['run']}: with all of the run known {began}{error}")
    for each in answer["runs"]:
        for alarm in each["alarms"]:
            console.print(f"{each['run']}: {alarm}")
    for line in usability_lines(answer["usability"]):
        console.print(line)
    if answer["innovation_rms_mV"] is not None:
        console.print(f"innovation: {answer['innovation_rms_mV']:.2f} mV RMS")
    console.print(f"{answer['gain']} gain, {answer['us_per_step']:.2f} us per step")
    console.print(f"stability: {answer['stability']}")
    for key in ("file", "report"):
        if key in answer:
            console.print(f"wrote {answer[key]}")


COMMAND = Command("observe", "replay measured runs through the state-of-charge observer", _arguments, _run)
