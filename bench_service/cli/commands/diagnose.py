"""`bench-service diagnose`: which effect is missing in a model, or new in its cell, with evidence."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING, Any

from bench_service.cli.command import Command
from bench_service.cli.judged_runs import add_judged_runs, read_judged_runs
from bench_service.cli.output import Output
from bench_service.cli.report_options import add_report, check_report, heading_of, write_report
from bench_service.cli.tables import usability_lines

if TYPE_CHECKING:
    from rich.console import Console


def _arguments(parser: ArgumentParser) -> None:
    add_judged_runs(parser)
    parser.add_argument(
        "--mode",
        choices=["structure", "change"],
        default="structure",
        help="structure: what does the model lack? change: the model was right, what is new?",
    )
    add_report(parser, "the evidence")


def _run(options: Namespace, output: Output) -> int:

    # Lazy: numba and scipy take 1.3 s.
    from bench_service.reports.diagnosis import diagnosis_report
    from models.diagnosis import diagnose

    check_report(options)
    judged = read_judged_runs(options, output)
    with output.progress("Diagnosing"):
        diagnosis = diagnose(
            judged.network,
            judged.runs,
            judged.soc,
            train=judged.train,
            train_soc=judged.train_soc,
            mode=options.mode,
            soc_std=judged.soc_std,
        )
    result = diagnosis.to_json() | {"usability": judged.network.record.usability}
    if options.report is not None:
        what = "What has changed" if options.mode == "change" else "What is missing"
        heading = heading_of(options, "Diagnosis", f"{what} in {options.model.stem}", judged.runs)
        made = diagnosis_report(heading, judged.network, judged.runs, judged.soc, result)
        result["report"] = write_report(options.report, made)
    output.result(result, lambda console: _show(console, result))
    return 0


def _show(console: Console, result: dict[str, Any]) -> None:
    # Lazy: numba and scipy take 1.2 s.
    from bench_service.reports.diagnosis import VERDICTS, confidence, left_over

    console.print(f"[bold]{VERDICTS[result['verdict']]}[/bold]")
    for finding in result["findings"]:
        console.print(
            f"\n{finding['rank']}. [bold]{finding['effect']}[/bold]  confidence {confidence(finding['confidence'])}  "
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
    for line in usability_lines(result["usability"]):
        console.print(line)
    for remark in result["remarks"]:
        console.print(f"note: {remark}")


COMMAND = Command("diagnose", "which effect is missing in a model, or new in its cell", _arguments, _run)
