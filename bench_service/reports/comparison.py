"""Report of a model held against measured runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bench_service.reports import words
from bench_service.reports.document import Heading, Key, Keys, Part, Points, Report, Section, Table
from bench_service.reports.free_run import curve_section, where_parts
from bench_service.reports.incremental import incremental_parts
from bench_service.reports.readouts import readout_section

if TYPE_CHECKING:
    from models.data.timeseries import TimeSeries
    from models.module.network import ModuleNetwork
    from models.network.local_model_network import LocalModelNetwork

_FIGURES = (("rmse_mV", "RMS"), ("mae_mV", "Mean size"), ("p95_mV", "95 % are below"), ("max_mV", "Largest"))
_VERDICTS = {"usable": "usable", "limited": "usable within limits", "unusable": "not usable"}


def comparison_report(
    heading: Heading,
    network: LocalModelNetwork | ModuleNetwork,
    runs: Sequence[TimeSeries],
    initial_soc: Sequence[float],
    result: Mapping[str, Any],
    called: Mapping[str, str] | None = None,
) -> Report:
    """Put the report together; simulates the runs for its curves.

    Parameters
    ----------
    network, runs, initial_soc : what was compared
    result : the answer of `models.comparison.figures.compare`
    called : what people call a run, by the name of its series
    """
    # Lazy: numba and scipy take 1.0 s.
    from models.comparison.placed_runs import place_runs
    from models.comparison.reach import bands
    from models.module.network import cell_network

    names = called or {}
    compared = place_runs(network, list(runs), list(initial_soc))
    found = bands(network, [each.run for each in compared], [each.start for each in compared])
    sections = [
        Section("Errors", [_errors(result, names), *_remarks(network, result, names)]),
        Section("Where the model fails", where_parts(result["regions"], result["where"])),
    ]
    for k, each in enumerate(compared):
        name = each.run.name
        drawn = curve_section(each, None if found is None else found[k], f"Run {names.get(name, name)}")
        sections.append(Section(drawn.title, [*drawn.parts, *incremental_parts(each, network.cell.capacity_Ah)]))
    return Report(heading, [_keys(result), *usability_parts(result.get("usability"))],
                  [*sections, readout_section(cell_network(network))])  # fmt: skip


def usability_parts(usability: Mapping[str, Any] | None) -> list[Part]:
    """How far a model can be used, and why."""
    if usability is None:
        return []
    reasons = [words.sentence(words.told(text)) for text in usability["reasons"]]
    said = f"The model is {_VERDICTS.get(usability['verdict'], usability['verdict'])}."
    return [f"{said} {reasons[0]}"] if len(reasons) == 1 else [said, *([Points(reasons)] if reasons else [])]


def _keys(result: Mapping[str, Any]) -> Keys:
    overall, band = result["overall"], result["band"]
    noise = result["noise_floor_mV"]
    against = "" if noise is None else f"noise of the measurement {words.millivolts(noise)}"
    keys = [
        Key("RMS error of the voltage", words.millivolts(overall["rmse_mV"]), against),
        Key("Largest error", words.millivolts(overall["max_mV"]), f"in {words.count(overall['n_samples'])} samples"),
        Key("Outside what it was trained on", words.percent(result["outside_training"], 1), "of the samples"),
    ]
    if band is not None and band["coverage_95"] is not None:
        keys.append(Key("Within the 95 % band", words.percent(band["coverage_95"], 1), "of the measured voltages"))
    return Keys(keys)


def _errors(result: Mapping[str, Any], names: Mapping[str, str]) -> Table:
    rows = [(f"Run {names.get(each['run'], each['run'])}", each) for each in result["runs"]]
    if len(rows) > 1:
        rows.append(("All runs", result["overall"]))
    if result["outside"] is not None and result["inside_training"] is not None:
        rows.append(("Within what the model was trained on", result["inside_training"]))
        rows.append(("Outside of it", result["outside"]))
    return Table(
        ("Of", *(name for _, name in _FIGURES), "Mean, measured − model", "RMS over the voltage's range", "Samples"),
        [error_row(name, metrics) for name, metrics in rows],
        frozenset(range(1, 8)),
    )


def error_row(name: str, metrics: Mapping[str, Any]) -> tuple[str, ...]:
    """One row of errors."""
    return (
        name,
        *(words.millivolts(metrics[key]) for key, _ in _FIGURES),
        words.millivolts(metrics["bias_mV"]),
        words.percent(metrics["nrmse"], 2),
        words.count(metrics["n_samples"]),
    )


def _remarks(
    network: LocalModelNetwork | ModuleNetwork, result: Mapping[str, Any], names: Mapping[str, str]
) -> list[Part]:
    """What else a reader must know of the errors."""
    # Lazy: numba and scipy take 1.0 s.
    from models.module.network import ModuleNetwork

    said = ["The model sees current and temperature only; it runs on its own past voltages."]
    by = [
        f"{words.variable(name)} {words.percent(share, 1)}"
        for name, share in result["outside_by"].items()
        if share > 0.0
    ]
    if by:
        said.append(f"Samples lie outside what the model was trained on by {words.listed(by)}.")
    temperature, whiteness = result["temperature"], result["whiteness"]
    said += [] if isinstance(network, ModuleNetwork) else _promised(network, result.get("expected_rmse_mV"))
    if temperature is not None and temperature["rmse_K"] is not None:
        said.append(f"Temperature from current and ambient alone: RMS error {temperature['rmse_K']:.2f} K.")
    if whiteness is not None:
        said.append(words.sentence(f"over time {words.told(whiteness['text'])}"))
    said += [_starts(result, names)]
    for each in result["corrections"]:
        sizes = [f"{words.plain(name)} {words.number(value)}" for name, value in each["values"].items()]
        said.append(f"The runs were corrected as the model says: {words.plain(each['effect'])}, {words.listed(sizes)}.")
    for each in result.get("baselines", []):
        said.append(f"Beside it, {each['name']}: RMS error {words.millivolts(each['overall']['rmse_mV'])}.")
    return [Points(said)]


def _promised(network: LocalModelNetwork, here_mV: float | None) -> list[str]:
    """What the model did on its own runs, and what it was expected to do on others, and on these."""
    said = []
    expected = (network.record.choices or {}).get("expected_rmse_mV")
    if expected is not None and network.record.train is not None:
        said.append(
            f"On its training runs the model's RMS error is {words.millivolts(network.record.train['rmse_mV'])}; "
            f"{words.millivolts(expected)} were expected on runs that it did not see."
        )
    if here_mV is not None:
        said.append(f"By where these runs go, {words.millivolts(here_mV)} were to be expected of them.")
    return said


def _starts(result: Mapping[str, Any], names: Mapping[str, str]) -> str:
    """What the error would be from starts that all of the voltage says, and where those lie."""

    def start(each: Mapping[str, Any]) -> str:
        found = each["initial_soc"]
        std = None if found["std"] is None else 100.0 * found["std"]
        return f"run {names.get(each['run'], each['run'])} at {words.quantity(100.0 * found['value'], '%', std)}"

    text = (
        f"From starts that fit all of the voltage best the RMS error is "
        f"{words.millivolts(result['overall_fitted_start']['rmse_mV'])}: "
        f"{words.listed([start(each) for each in result['runs']])} state of charge."
    )
    unrested = [names.get(each["run"], each["run"]) for each in result["runs"] if each["started"] != "as_stated"]
    return text + (f" Not at rest at first: run {words.listed(unrested)}." if unrested else "")
