"""`bench-service compare`: free-run error of a model on measured runs, and where it lies."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.cli.arguments import fractions, names
from bench_service.cli.command import Command
from bench_service.cli.files import add_current_sign, read_any_model, read_logs, read_runs
from bench_service.cli.initial_soc import initial_soc, known_starts
from bench_service.cli.module_tables import show_module
from bench_service.cli.output import Output
from bench_service.cli.report_options import add_report, check_report, heading_of, runs_text, write_report
from bench_service.cli.tables import metrics_table, start_line, usability_lines, where_table

if TYPE_CHECKING:
    from rich.console import Console

_WORST = 8


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("model", type=Path, metavar="MODEL.json", help="of a cell, or of a module")
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN", help="CSV, gzipped CSV or Parquet")
    parser.add_argument(
        "--initial-soc", type=fractions, action="extend", metavar="S[,S...]", help="one value, or one for each run"
    )
    parser.add_argument(
        "--baseline",
        type=names,
        action="extend",
        default=[],
        metavar="NAME[,NAME...]",
        help="also fit these to the runs of --train and judge them: 1rc, 2rc (equivalent circuits), esc (Plett)",
    )
    parser.add_argument(
        "--train",
        type=Path,
        nargs="+",
        action="extend",
        default=[],
        metavar="RUN",
        help="runs the model was made from, for --baseline",
    )
    parser.add_argument(
        "--train-initial-soc", type=fractions, action="extend", metavar="S[,S...]", help="SoC at the start of those"
    )
    parser.add_argument("--out", type=Path, metavar="SERIES.csv", help="also write both voltages with the band")
    add_report(parser, "curves and tables")
    add_current_sign(parser)


def _run(options: Namespace, output: Output) -> int:
    # Lazy: numba and scipy take 1.4 s.
    from bench_service.exchange.atomic import check_writable
    from bench_service.exchange.write import write_results
    from models.baselines.beside import beside_baselines
    from models.comparison.figures import compare
    from models.comparison.module_models import compare_module
    from models.comparison.series import series_columns
    from models.module.network import ModuleNetwork

    check_report(options)
    if options.out is not None:
        check_writable(options.out)
    network = read_any_model(options.model)
    logs = read_logs(options.runs, options.current_sign, output)
    runs = [log.run for log in logs]
    learned = read_runs(options.train, options.current_sign, output)
    train = learned, initial_soc(learned, options.train_initial_soc)
    starts = known_starts(runs, options.initial_soc, network, output)
    soc = [value for value, _ in starts]
    with output.progress("Simulating"):
        result: dict[str, Any] = dict(compare(network, runs, soc, [std for _, std in starts]))
        if options.baseline:
            result["baselines"] = beside_baselines(network, options.baseline, train, (runs, soc))
        if isinstance(network, ModuleNetwork):
            result["module"] = compare_module(network, logs, soc)
    if options.out is not None:
        write_results(options.out, series_columns(network, runs, soc))
        result["file"] = str(options.out)
    if options.report is not None:
        from bench_service.reports.comparison import comparison_report

        heading = heading_of(options, "Comparison", f"{options.model.stem} against {runs_text(runs)}", runs)
        result["report"] = write_report(options.report, comparison_report(heading, network, runs, soc, result))
    output.result(result, lambda console: _show(console, result))
    return 0


def _show(console: Console, result: dict[str, Any]) -> None:
    rows = [(each["run"], each) for each in result["runs"]]
    if len(rows) > 1:
        rows.append(("overall", result["overall"]))
    if result["outside"] is not None and result["inside_training"] is not None:
        rows += [("inside the trained domain", result["inside_training"]), ("outside of it", result["outside"])]
    console.print(metrics_table("Free run against measurement", rows))
    if "baselines" in result:
        beside = [(each["name"], each["overall"]) for each in result["baselines"]]
        console.print(
            metrics_table("Beside it, fitted to the training runs", [("the model", result["overall"]), *beside])
        )
    if "module" in result:
        show_module(console, result["module"])
    for line in usability_lines(result["usability"]):
        console.print(line)
    if result["expected_rmse_mV"] is not None:
        console.print(f"expected on runs that go where these go: {result['expected_rmse_mV']:.2f} mV RMS")
    console.print(start_line(result))
    for each in result["corrections"]:
        sizes = ", ".join(f"{name} {value:.4g}" for name, value in each["values"].items())
        console.print(f"the runs were corrected as the model says: {each['effect']} ({sizes})")
    if result["noise_floor_mV"] is not None:
        console.print(f"noise floor of the measurement: {result['noise_floor_mV']:.2f} mV")
    if result["whiteness"] is not None:
        console.print(result["whiteness"]["text"])
    console.print("\n[bold]Where it fails[/bold]")
    for each in result["regions"]:
        console.print(f"  {each['text']} ({each['rmse_mV']:.1f} mV there)")
    if not result["regions"]:
        console.print("  no region stands out: the error is spread evenly")
    console.print(where_table("By one variable (the most telling first)", result["where"][:_WORST]))
    console.print(f"outside the trained domain: {100 * result['outside_training']:.1f} % of the samples")
    for name, share in result["outside_by"].items():
        if share > 0.0:
            console.print(f"  of them by {name}: {100 * share:.1f} %")
    _show_gaps(console, result["gaps"])
    if result["band"] is not None and result["band"]["coverage_95"] is not None:
        band = result["band"]
        console.print(
            f"95 % band: ± {band['mean_half_width_mV']:.2f} mV on average, {100 * band['coverage_95']:.1f} % of the "
            "measured voltages lie within"
        )
    _show_temperature(console, result["temperature"])
    for key in ("file", "report"):
        if key in result:
            console.print(f"{key}: {result[key]}")


def _show_gaps(console: Console, gaps: list[dict[str, Any]]) -> None:
    from models.data.lost_temperature import BRIDGED_S

    for each in gaps:
        if each["gaps"]:
            console.print(
                f"{each['run']}: no voltage at {100 * each['missing_share']:.1f} % of the samples, "
                f"{each['gaps']} gap(s), the longest {each['longest_gap_s']:.0f} s"
            )
        if each["without_temperature_s"] > BRIDGED_S:
            console.print(f"{each['run']}: no temperature for {each['without_temperature_s']:.0f} s at a time")


def _show_temperature(console: Console, temperature: dict[str, Any] | None) -> None:
    if temperature is None:
        return
    if temperature["rmse_K"] is not None:
        console.print(f"temperature from current and ambient alone: RMSE {temperature['rmse_K']:.2f} K")
    for text in temperature["reservations"]:
        console.print(f"note: {text}")


COMMAND = Command("compare", "compare a model with measured runs in free run", _arguments, _run)
