"""`bench-service design`: the test that tells the most about a cell, inside its limits."""

from __future__ import annotations

import math
import tomllib
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.cli.command import Command
from bench_service.cli.errors import UsageError
from bench_service.cli.files import read_model, read_runs
from bench_service.cli.output import Output
from bench_service.cli.report_options import add_report, check_report, design_heading, write_report
from bench_service.cli.tables import usability_lines

if TYPE_CHECKING:
    from rich.console import Console

    from models.design.answer import Material
    from models.design.request import WrittenRequest
    from models.design.sequence.profile import Profile


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("request", type=Path, metavar="REQUEST.toml", help="limits, duration, model and criterion")
    parser.add_argument("--out", type=Path, required=True, metavar="PROFILE.csv", help="columns time_s,current_A")
    add_report(parser, "pictures of the test")


def _run(options: Namespace, output: Output) -> int:
    # Lazy: numba and scipy take 1.4 s.
    from bench_service.exchange.atomic import check_writable, write_atomically
    from models.design.answer import answer
    from models.design.request import read_request

    check_report(options)
    check_writable(options.out)
    request = read_request(_read_toml(options.request))
    material = _material(request, options.request.parent, output)
    with output.progress("Designing") as report:
        found = answer(request, material, report)
    if found.design is None:
        output.warn(
            "no model and no runs: this is a bounded pre-test. Play it, then name its run in runs (or fit a model and "
            "name that) and design again"
        )
    if request.initial_soc is None:
        output.warn("no initial_soc: the design takes 0.5 as the start")
    write_atomically(options.out, _csv(found.profile))
    figures = {"profile": str(options.out), **found.figures}
    if options.report is not None:
        from bench_service.reports.design import design_report

        heading = design_heading(options, options.out.stem, request.model)
        figures["report"] = write_report(options.report, design_report(heading, found))
    output.result(figures, lambda console: _show(console, figures))
    return 0


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        reason = "no such file" if isinstance(error, FileNotFoundError) else error.strerror or str(error)
        raise UsageError(f"{path}: {reason}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: is not valid TOML: {error}") from error


def _material(request: WrittenRequest, beside: Path, output: Output) -> Material:
    """Read what the request names; names are relative to its file."""
    # Lazy: numba and scipy take 1.4 s.
    from models.design.answer import Material
    from models.design.rivals import is_effect

    cycle_A, cycle_dt_s = None, 1.0
    if request.load_cycle is not None:
        cycle_A, cycle_dt_s = _load_cycle(beside / request.load_cycle)
    return Material(
        network=None if request.model is None else read_model(beside / request.model),
        runs=tuple(read_runs([beside / run for run in request.runs], None, output)),
        cycle_A=cycle_A,
        cycle_dt_s=cycle_dt_s,
        rivals=tuple(rival if is_effect(rival) else read_model(beside / rival) for rival in request.rivals),
    )


def _load_cycle(path: Path) -> tuple[Any, float]:
    """Read a current over time, forward hold, onto an even grid of its shortest step."""
    # Lazy: numba and scipy take 1.4 s.
    from bench_service.exchange.profile import read_profile
    from models.design.answer import even_cycle

    cycle = read_profile(path)
    return even_cycle(cycle.time_s, cycle.current_A)


def _csv(profile: Profile) -> bytes:
    rows = zip(profile.time_s.tolist(), profile.current_A.tolist(), strict=True)
    return ("time_s,current_A\n" + "".join(f"{t!r},{i!r}\n" for t, i in rows)).encode()


def _show(console: Console, figures: dict[str, Any]) -> None:
    hours = figures["duration_s"] / 3600.0
    console.print(
        f"{figures['profile']}: {hours:.2f} h, {figures['n_samples']} samples, {figures['throughput_Ah']:.2f} Ah moved "
        f"({figures['net_charge_Ah']:+.3f} Ah net), designed in {figures['seconds']:.1f} s"
    )
    low, high = figures["predicted"]["soc"]
    text = f"predicted: SoC {low:.3f} to {high:.3f}"
    if figures["predicted"]["voltage_V"] is not None:
        least, most = figures["predicted"]["voltage_with_band_V"]
        text += f", voltage {least:.3f} to {most:.3f} V with its band"
    console.print(text)
    if "constants_std" in figures:
        known = (f"{name} {100.0 * std:.2g} %" for name, std in figures["constants_std"].items())
        console.print(f"constants that a fit takes as given, known after it to: {', '.join(known)}")
    if "coverage" in figures:
        _show_coverage(console, figures["coverage"])
    if "accuracy" in figures:
        said = figures["accuracy"]
        console.print(
            f"largest standard deviation {said['largest_std']:.3g} after {said['visits']} visits, "
            f"{said['target_std']:g} {'reached' if said['reached'] else 'not reached'}: {said['saved_h']:.2f} h of "
            f"{said['planned_s'] / 3600.0:.2f} h saved"
        )
    for line in usability_lines(figures["usability"]):
        console.print(line)
    if not figures["pre_test"]:
        stds = list(figures["parameter_std"].values())
        mean = math.exp(sum(math.log(std) for std in stds) / len(stds))
        console.print(
            f"log det of the information {figures['log_det_information']:.2f}; geometric mean of {len(stds)} parameter "
            f"standard deviations {mean:.3g} (normalised); {100.0 * figures['constraints_active_share']:.0f} % of the "
            "samples lie at a limit"
        )


def _show_coverage(console: Console, said: dict[str, Any]) -> None:
    low, high = said["soc"]
    text = f"goes through {100.0 * said['share']:.0f} % of the asked SoC and current, SoC {low:.3f} to {high:.3f}"
    if said["temperature_degC"] is not None:
        least, most = said["temperature_degC"]
        text += f", {least:.1f} to {most:.1f} degC by its own heat"
    console.print(text)
    for reason in said["reasons"]:
        console.print(reason)


COMMAND = Command("design", "design the test that tells the most about a cell, inside its limits", _arguments, _run)
